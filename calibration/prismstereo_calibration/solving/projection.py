"""The projection and its exact derivatives: what the solver needs besides `Camera.project` itself.

A lens is a row of nine numbers here: fx, fy, cx, cy in pixels, then k1, k2, p1, p2, k3 (see `prismstereo_hw.lens` for
the model). Points become slopes, through glass where there is some, and slopes become pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.plate import Plate
from prismstereo_hw.lens import Lens

__all__ = ["LENS_NUMBERS", "Projection", "lens_of", "numbers_of", "project"]

Array = NDArray[np.float64]
LENS_NUMBERS = 9


def lens_of(numbers: Array) -> Lens:
    """Make the lens of its nine numbers (9,)."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = (float(number) for number in numbers)
    return Lens(fx, fy, cx, cy, (k1, k2, p1, p2, k3))


def numbers_of(lens: Lens) -> Array:
    """Return the nine numbers (9,) of a lens."""
    return np.array([lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion])


@dataclass(frozen=True, slots=True)
class Projection:
    """Pixels (..., 2) of points, and how they move with the lens (..., 2, 9) and with the point (..., 2, 3)."""

    pixels: Array
    by_lens: Array
    by_point: Array


def project(numbers: Array, points: Array, plate: Plate | None = None) -> Projection:
    """Project points (..., 3) of a camera's own frame, z > 0, through the lens of nine numbers (9,) behind a plate."""
    slopes, moves = _pinhole(points) if plate is None else plate.seen(points)
    pixels, by_lens, by_slope = _bend(numbers, slopes)
    return Projection(pixels, by_lens, by_slope @ moves)


def _pinhole(points: Array) -> tuple[Array, Array]:
    """Return the slopes (..., 2) of points as a pinhole sees them, and how they move with the points (..., 2, 3)."""
    Z = points[..., 2]
    slopes = points[..., :2] / Z[..., None]
    moves = np.zeros((*Z.shape, 2, 3))
    moves[..., 0, 0] = moves[..., 1, 1] = 1 / Z
    moves[..., 2] = -slopes / Z[..., None]
    return slopes, moves


def _bend(numbers: Array, slopes: Array) -> tuple[Array, Array, Array]:
    """Take slopes to pixels (..., 2), with their derivatives by the lens (..., 2, 9) and by the slopes (..., 2, 2)."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = numbers
    a, b = slopes[..., 0], slopes[..., 1]
    aa, bb, ab = a * a, b * b, a * b
    s = aa + bb
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    growth = k1 + s * (2 * k2 + 3 * k3 * s)  # d radial / d s
    bent_a = a * radial + 2 * p1 * ab + p2 * (s + 2 * aa)
    bent_b = b * radial + p1 * (s + 2 * bb) + 2 * p2 * ab

    by_lens = np.zeros((*a.shape, 2, LENS_NUMBERS))
    by_lens[..., 0, 0], by_lens[..., 1, 1] = bent_a, bent_b
    by_lens[..., 0, 2] = by_lens[..., 1, 3] = 1.0
    for column, (da, db) in enumerate(
        ((a * s, b * s), (a * s * s, b * s * s), (2 * ab, s + 2 * bb), (s + 2 * aa, 2 * ab), (a * s**3, b * s**3)),
        start=4,
    ):
        by_lens[..., 0, column], by_lens[..., 1, column] = fx * da, fy * db

    cross = 2 * ab * growth + 2 * p1 * a + 2 * p2 * b  # d bent_a / d b, and d bent_b / d a alike
    by_slope = np.empty((*a.shape, 2, 2))
    by_slope[..., 0, 0] = fx * (radial + 2 * aa * growth + 2 * p1 * b + 6 * p2 * a)
    by_slope[..., 0, 1], by_slope[..., 1, 0] = fx * cross, fy * cross
    by_slope[..., 1, 1] = fy * (radial + 2 * bb * growth + 6 * p1 * b + 2 * p2 * a)
    return np.stack([fx * bent_a + cx, fy * bent_b + cy], axis=-1), by_lens, by_slope
