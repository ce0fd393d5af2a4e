"""How measured points move with what the calibration does not know.

The pixels of both views stand fixed; what moves with the 24 numbers (see `prismstereo_calibration.uncertainty`) is where their
rays meet. Gradients of several points can be added up before they become a sigma, so what all of them share cancels as it
should: a length hardly changes when everything is turned.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.export.geometry import FrameGeometry
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.judging.sensitivity import derivative
from prismstereo_calibration.judging.triangulation import meet
from prismstereo_calibration.rectification import rectification

__all__ = ["MOST_POINTS", "point_gradients", "sigma_along"]

Array = NDArray[np.float64]
MOST_POINTS = 144  # that stand for all points of a fit: what a calibration leaves open is smooth


def point_gradients(geometry: FrameGeometry, points: Array) -> Array | None:
    """Return how points (N, 3) of the rectified frame move with the 24 numbers, (N, 3, 24); None if nothing is known."""
    calibration = geometry.calibration
    if calibration.uncertainty is None:
        return None
    left = rectification(calibration).left
    R = left.R_rectified_from_left
    true = left.pinhole + points @ R
    left_px, right_px = calibration.left.project(true), calibration.right.project(true)

    def found(one: Camera, other: Camera) -> Array:
        return np.asarray(meet(one.rays(left_px), other.rays(right_px))[0] @ R.T)

    return derivative(calibration, found)


def sigma_along(geometry: FrameGeometry, gradient: Array | None) -> float | None:
    """Return one sigma of something that moves as `gradient` (24,) says; None if nothing is known of the calibration."""
    known = geometry.calibration.uncertainty
    return None if known is None or gradient is None else float(known.along(gradient))
