"""Hartley's form: two homographies from the fundamental matrix alone. Always fits, and may bend the pictures badly."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.uncalibrated.pictures import ViewPictures

__all__ = ["fit_fundamental", "fit_hartley"]

Array = NDArray[np.float64]


def fit_fundamental(left: Array, right: Array) -> Array | None:
    """Fit the fundamental matrix (3, 3) to matches (N, 2), N >= 8; None where they do not determine one."""
    F, _ = cv2.findFundamentalMat(left, right, cv2.FM_8POINT)
    return None if F is None or F.shape != (3, 3) else np.asarray(F, np.float64)


def fit_hartley(left: Array, right: Array, pictures: ViewPictures) -> tuple[Array, Array] | None:
    """Return homographies (3, 3) from upright pixels of both views to rectified ones; None where there are none."""
    a, b = (points - pictures.corners(side)[0] for side, points in ((0, left), (1, right)))
    F = fit_fundamental(a, b)
    if F is None:
        return None
    done, H_left, H_right = cv2.stereoRectifyUncalibrated(a, b, F, (pictures.width, pictures.height))
    if not done:
        return None
    to_cut = [np.eye(3), np.eye(3)]
    for side in (0, 1):
        to_cut[side][:2, 2] = -pictures.corners(side)[0]
    return np.asarray(H_left, np.float64) @ to_cut[0], np.asarray(H_right, np.float64) @ to_cut[1]
