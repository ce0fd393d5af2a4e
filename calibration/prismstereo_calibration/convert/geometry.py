"""Matrices of others as lenses and poses, each refused by the name of the field in which it stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.convert.document import Field
from prismstereo_hw.lens import Lens

__all__ = ["distortion_of", "lens_of_matrix", "lens_of_numbers", "require_right_of_left", "rotation_of"]

Array = NDArray[np.float64]
_ROUNDED = 1e-3  # a file of three or four digits is still a rotation
_EXACT = 1e-9
_PARAMETERS = 5
_MOST_PARAMETERS = 14


def rotation_of(matrix: Array, field: Field) -> Array:
    """Return a rotation (3, 3): as it stands, or the nearest one where a file rounded it; `CalibrationError` for others."""
    defect = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if not defect <= _ROUNDED or np.linalg.det(matrix) < 0:
        raise field.refuse(
            f"is no rotation: its rows miss unit length and right angles by {defect:.2g}, or it mirrors; calibrate again"
        )
    if defect <= _EXACT:
        return matrix
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ v)


def distortion_of(numbers: Array, field: Field) -> tuple[float, float, float, float, float]:
    """Return k1, k2, p1, p2, k3 of none, four or more coefficients in OpenCV's order; those beyond must be 0."""
    if len(numbers) > _MOST_PARAMETERS or len(numbers) in (1, 2, 3):
        raise field.refuse(f"has {len(numbers)} coefficients: give 4 or 5 of them, or 8, 12 or 14 with zeros beyond k3")
    if np.any(numbers[_PARAMETERS:]):
        raise field.refuse("has coefficients beyond k3: only k1, k2, p1, p2, k3 are known here, calibrate with these")
    k1, k2, p1, p2, k3 = (float(value) for value in (*numbers, *np.zeros(_PARAMETERS))[:_PARAMETERS])
    return k1, k2, p1, p2, k3


def lens_of_matrix(K: Array, distortion: tuple[float, float, float, float, float], field: Field) -> Lens:
    """Return the lens of a camera matrix (3, 3); `CalibrationError` for one with skew or without focal length."""
    fixed = K[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]]
    if not np.array_equal(fixed, [0, 0, 0, 0, 1]):
        raise field.refuse("is no camera matrix: it must be fx 0 cx, 0 fy cy, 0 0 1 by rows, without skew")
    return lens_of_numbers(K[0, 0], K[1, 1], K[0, 2], K[1, 2], distortion, field)


def lens_of_numbers(
    fx: float, fy: float, cx: float, cy: float, distortion: tuple[float, float, float, float, float], field: Field
) -> Lens:
    """Return the lens of focal lengths and principal point in px; `CalibrationError` for a focal length of 0 or less."""
    if not min(fx, fy) > 0:
        raise field.refuse(f"has focal lengths {fx:g}, {fy:g} px: they must be positive")
    return Lens(float(fx), float(fy), float(cx), float(cy), distortion)


def require_right_of_left(R: Array, t: Array, field: Field) -> None:
    """Refuse a baseline that is nothing, or leads to the left: left and right are exchanged."""
    centre = -R.T @ t
    if not np.any(t):
        raise field.refuse("is 0 in all parts: two views from one place are no stereo pair")
    if not centre[0] + (R @ centre)[0] > 0:
        raise field.refuse(
            f"puts the right camera at {np.round(centre, 3)} of the left one, a negative baseline: left and right are "
            "exchanged, give them the other way round"
        )
