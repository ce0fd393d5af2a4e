"""Two pictures related by nothing but points: distances from epipolar lines, and what a homography does to a picture.

Pixels (N, 2) are upright coordinates of their view; F takes a left pixel to its line in the right view.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["homogeneous", "mapped", "row_errors", "sampson", "sampson_homogeneous"]

Array = NDArray[np.float64]


def homogeneous(pixels: Array) -> Array:
    """Append a one: (..., 2) to (..., 3)."""
    return np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)


def sampson(F: Array, left: Array, right: Array) -> Array:
    """Return how far matches (N, 2) are from obeying F (3, 3): signed pixels (N,), to first order."""
    return sampson_homogeneous(F, homogeneous(left).T, homogeneous(right).T)


def sampson_homogeneous(F: Array, left: Array, right: Array) -> Array:
    """Return the same for matches (3, N) whose third coordinate is one."""
    in_right, in_left = F @ left, F[:, :2].T @ right
    squares = in_right[0] ** 2 + in_right[1] ** 2 + in_left[0] ** 2 + in_left[1] ** 2
    return np.asarray((right[0] * in_right[0] + right[1] * in_right[1] + in_right[2]) / np.sqrt(squares))


def mapped(H: Array, pixels: Array) -> Array:
    """Take pixels (..., 2) through a homography (3, 3)."""
    q = homogeneous(pixels) @ H.T
    return np.asarray(q[..., :2] / q[..., 2:])


def row_errors(H_left: Array, H_right: Array, left: Array, right: Array) -> Array:
    """Return by how many rows (N,) matches miss each other once both views are rectified: right less left."""
    return np.asarray(mapped(H_right, right)[:, 1] - mapped(H_left, left)[:, 1])
