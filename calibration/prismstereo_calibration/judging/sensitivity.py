"""How something that both cameras see moves with the 24 numbers of a calibration (see `uncertainty.NUMBERS`).

By central differences, so it holds for every lens, glass and mirrored views included. A number that the uncertainty says is
known exactly is left alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.poses import rotations
from prismstereo_calibration.uncertainty import NUMBERS
from prismstereo_hw.lens import Lens

__all__ = ["derivative", "nudged"]

Array = NDArray[np.float64]
_LENS = 9
_FOCAL_STEP = 1e-4  # of the focal length
_CENTRE_STEP_PX = 0.1
_BEND_STEP = 1e-4  # of k1, k2, p1, p2, k3
_TURN_STEP_RAD = 1e-5
_SHIFT_STEP = 1e-4  # of the baseline


def derivative(calibration: Calibration, function: Callable[[Camera, Camera], Array]) -> Array:
    """Return how `function` of the left and the right camera, (...), moves with the numbers: (..., 24)."""
    known = calibration.uncertainty
    moving = np.ones(len(NUMBERS), bool) if known is None else np.diag(known.covariance) > 0
    columns: list[Array | None] = []
    for number in range(len(NUMBERS)):
        if not moving[number]:
            columns.append(None)
            continue
        step = _step(calibration, number)
        ahead, behind = (function(*nudged(calibration, number, by)) for by in (step, -step))
        columns.append((ahead - behind) / (2 * step))
    shape = next((column.shape for column in columns if column is not None), None)
    if shape is None:
        shape = function(calibration.left, calibration.right).shape
    return np.stack([np.zeros(shape) if column is None else column for column in columns], axis=-1)


def nudged(calibration: Calibration, number: int, by: float) -> tuple[Camera, Camera]:
    """Return the left and the right camera with one number moved; the camera it does not touch is the same object."""
    left, right = calibration.left, calibration.right
    if number < _LENS:
        return replace(left, lens=_bent(left.lens, number, by)), right
    if number < 2 * _LENS:
        return left, replace(right, lens=_bent(right.lens, number - _LENS, by))
    axis = np.zeros(3)
    axis[(number - 2 * _LENS) % 3] = by
    if number < 2 * _LENS + 3:
        return left, replace(right, R_camera_from_left=rotations(axis) @ right.R_camera_from_left)
    return left, replace(right, t_camera_from_left=right.t_camera_from_left + axis)


def _step(calibration: Calibration, number: int) -> float:
    if number >= 2 * _LENS:
        return _TURN_STEP_RAD if number < 2 * _LENS + 3 else _SHIFT_STEP * calibration.baseline
    of_lens = number % _LENS
    if of_lens < 2:
        return _FOCAL_STEP * calibration.left.lens.fx_px
    return _CENTRE_STEP_PX if of_lens < 4 else _BEND_STEP


def _bent(lens: Lens, number: int, by: float) -> Lens:
    """Return a lens with one of fx, fy, cx, cy, k1, k2, p1, p2, k3 moved."""
    numbers = [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion]
    numbers[number] += by
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = numbers
    return replace(lens, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, distortion=(k1, k2, p1, p2, k3))
