"""How high something stands over a plane."""

from __future__ import annotations

import numpy as np

from prismstereo.measuring.calibration_share import point_gradients, sigma_along
from prismstereo.measuring.fix import fix
from prismstereo.measuring.measured import Measured
from prismstereo.measuring.plane import Plane
from prismstereo.measuring.relief import Relief

__all__ = ["height_over"]


def height_over(relief: Relief, plane: Plane, at: tuple[float, float]) -> Measured:
    """Measure what a pixel (column, row) shows, square to a plane: positive on the side of the camera.

    `UsageError` where nothing was matched there.
    """
    point = fix(relief, *at)
    length = float(np.linalg.norm(plane.q))
    height = plane.distance.value_mm - float(plane.normal @ point.point)
    of_q = -point.point / length - height * plane.q / length**2
    of_depth = float(plane.normal @ point.ray) * point.sigma_depth_mm
    matching = float(np.hypot(np.sqrt(of_q @ plane.q_covariance @ of_q), of_depth))
    moves = point_gradients(relief.geometry, point.point[None])
    gradient = None
    if moves is not None and plane.gradient is not None:
        gradient = plane.gradient[3] - point.point @ plane.gradient[:3] - plane.normal @ moves[0]
    return Measured.of(height, matching, sigma_along(relief.geometry, gradient))
