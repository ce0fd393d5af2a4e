"""How far two points of a surface lie apart."""

from __future__ import annotations

import math

import numpy as np

from prismstereo.measuring.calibration_share import point_gradients, sigma_along
from prismstereo.measuring.fix import Fix, fix
from prismstereo.measuring.measured import Measured
from prismstereo.measuring.relief import Relief
from prismstereo_hw.errors import UsageError

__all__ = ["distance", "span"]

Pixel = tuple[float, float]


def distance(relief: Relief, first: Pixel, second: Pixel) -> Measured:
    """Measure between what two pixels (column, row) show, straight through the air; `UsageError` where one shows nothing."""
    return span(relief, fix(relief, *first), fix(relief, *second))


def span(relief: Relief, first: Fix, second: Fix) -> Measured:
    """Measure between two points that were fixed before."""
    apart = second.point - first.point
    length = float(np.linalg.norm(apart))
    if length == 0:
        raise UsageError(f"both points are at {first.column:g},{first.row:g}: give two different ones")
    along = apart / length
    shares = [float(along @ one.ray) * one.sigma_depth_mm for one in (first, second)]
    gradients = point_gradients(relief.geometry, np.stack([first.point, second.point]))
    gradient = None if gradients is None else along @ (gradients[1] - gradients[0])
    return Measured.of(length, math.hypot(*shares), sigma_along(relief.geometry, gradient))
