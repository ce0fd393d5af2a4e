"""Where the rays of two pixels meet: the middle of the shortest line between them, and how long that line is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration

__all__ = ["Rays", "meet", "triangulate"]

Array = NDArray[np.float64]
Rays = tuple[Array, Array]  # a point (..., 3) on each ray, its unit direction (..., 3)

_SMALLEST_SINE = 1e-9  # of the angle between two rays that meet


def triangulate(calibration: Calibration, left_px: Array, right_px: Array) -> tuple[Array, Array]:
    """Intersect the rays of two upright pixels (..., 2) each; NaN where a pixel is NaN.

    Returns the middle of the shortest line between them (..., 3), in the left camera's frame and the calibration's unit,
    and the length of that line (...).
    """
    return meet(calibration.left.rays(left_px), calibration.right.rays(right_px))


def meet(left: Rays, right: Rays) -> tuple[Array, Array]:
    """Return the middle (..., 3) of the shortest line between two rays, and its length (...)."""
    (from_a, a), (from_b, b) = left, right
    apart = from_b - from_a
    cosine = np.sum(a * b, axis=-1)
    sine2 = np.maximum(1 - cosine**2, _SMALLEST_SINE**2)
    along_a, along_b = np.sum(a * apart, axis=-1), np.sum(b * apart, axis=-1)
    reach_a = (along_a - cosine * along_b) / sine2
    reach_b = (cosine * along_a - along_b) / sine2
    on_a, on_b = from_a + reach_a[..., None] * a, from_b + reach_b[..., None] * b
    return (on_a + on_b) / 2, np.linalg.norm(on_b - on_a, axis=-1)
