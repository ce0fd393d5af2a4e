"""One point of a surface: what the matches around a pixel agree on, and how far along its ray it may be off.

Noise of the matches. In a window of 9x9 pixels the disparities of one surface lie on a plane, but for their noise: what is
left over of a robust fit is one standard deviation of its value in the middle, for neighbours share most of their noise (on the
twin's textured planes 0.022 px are told and 0.023 px are true). A sixteenth of a pixel is the finest step on the wire, and its
rounding comes on top; so does `LEAN_PX`, for fractions of a pixel lean all over a surface. What shifts a whole neighbourhood
more, as at the border of a nearer thing, cannot be seen this way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.measuring.relief import Relief
from prismstereo_calibration.judging.uncertainty_map import MATCHING_NOISE_PX
from prismstereo_device.disparity import FRACTION
from prismstereo_hw.errors import UsageError

__all__ = ["LEAN_PX", "ROUNDING_PX", "Fix", "fix"]

Array = NDArray[np.float64]

LEAN_PX = (
    0.02  # that a whole surface is off by: 0.001 to 0.06 px on the twin's planes, the most on one that faces the camera
)
ROUNDING_PX = 1 / FRACTION / math.sqrt(12)
_REACH = 4  # pixels from the middle of the window to its border
_FEWEST = 12  # that a plane and its noise are read from
_SAME_SURFACE_PX = 2.0  # disparity that a surface gains or loses from the middle to the border
_ROUNDS = 4
_TRIM, _LEAST_TRIM_PX = 3.5, 0.06
_MAD = 1.4826  # standard deviation of normal noise over its median absolute value


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """A point (3,) mm, the pixel it was asked at, its ray (3,) with z one, and one sigma of its depth and its disparity."""

    column: float
    row: float
    point: Array
    ray: Array
    sigma_px: float
    sigma_depth_mm: float


def fix(relief: Relief, column: float, row: float) -> Fix:
    """Fix the point that a pixel, whole or not, shows; `UsageError` where nothing was matched there."""
    height, width = relief.inverse_px.shape
    if not (-0.5 <= column < width - 0.5 and -0.5 <= row < height - 0.5):
        raise UsageError(f"point {column:g},{row:g} is outside of the map of {width}x{height}: give one inside")
    x, y = math.floor(column + 0.5), math.floor(row + 0.5)
    own = float(relief.inverse_px[y, x])
    if not math.isfinite(own):
        raise UsageError(f"nothing was matched at {column:g},{row:g}: {_nearest(relief, x, y)}")
    inverse, sigma_px = _local(relief, x, y, column, row)
    ray = relief.rays(np.array(column), np.array(row))
    depth = relief.scale_px / inverse
    return Fix(column, row, depth * ray, ray, sigma_px, depth / inverse * sigma_px)


def _local(relief: Relief, x: int, y: int, column: float, row: float) -> tuple[float, float]:
    """Return the disparity + offset at a pixel by the plane of its neighbourhood, and one sigma of it."""
    top, first = max(y - _REACH, 0), max(x - _REACH, 0)
    window = relief.inverse_px[top : y + _REACH + 1, first : x + _REACH + 1]
    own = float(relief.inverse_px[y, x])
    rows, columns = np.nonzero(np.abs(window - own) < _SAME_SURFACE_PX)
    values = window[rows, columns]
    J = np.column_stack([np.ones(len(values)), columns + first - column, rows + top - row])
    kept = np.ones(len(values), bool)
    for _ in range(_ROUNDS):
        if kept.sum() < _FEWEST:
            return own, MATCHING_NOISE_PX  # it stands alone, as speckles do
        plane = np.linalg.lstsq(J[kept], values[kept], rcond=None)[0]
        off = np.abs(values - J @ plane)
        kept = off <= max(_TRIM * _MAD * float(np.median(off)), _LEAST_TRIM_PX)
    if kept.sum() < _FEWEST:
        return own, MATCHING_NOISE_PX
    left_over = float(np.sqrt(np.sum(off[kept] ** 2) / (kept.sum() - 3)))
    if abs(own - plane[0]) > _SAME_SURFACE_PX / 2:
        return own, MATCHING_NOISE_PX
    return float(plane[0]), math.hypot(left_over, ROUNDING_PX, LEAN_PX)


def _nearest(relief: Relief, x: int, y: int) -> str:
    rows, columns = np.nonzero(np.isfinite(relief.inverse_px))
    if not len(rows):
        return "nor anywhere else in this frame"
    index = int(np.argmin((columns - x) ** 2 + (rows - y) ** 2))
    return f"the nearest match is at {columns[index]},{rows[index]}"
