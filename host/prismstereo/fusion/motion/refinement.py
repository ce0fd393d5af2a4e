"""Make a model finer than features are: follow corners from the warped still to the frame, and fit again."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.features import Matches
from prismstereo.fusion.motion.models import MotionModel
from prismstereo.fusion.motion.picture import HALF_STEP
from prismstereo.fusion.motion.warp import Box

__all__ = ["followed_corners"]

Float = NDArray[np.float32]
_MOST = 400
_QUALITY = 0.01
_BETWEEN_PX = 5.0
_WINDOW = 21
_SAME_WAY_PX = 0.25  # there and back, fine pixels
_EVEN_PX = 8.0  # over which brightness and contrast are evened out
_FEWEST = 12


def followed_corners(
    frame: Float, model: Float, inside: NDArray[np.bool_], motion: MotionModel, box: Box
) -> Matches | None:
    """Follow corners of the still, as `motion` shows it, to where the frame has them: matches still to frame, video pixels.

    `frame` and `model` (2 rows, 2 columns) float32 are the box of the frame at two pixels for one; corners lie where `inside`
    (2 rows, 2 columns) holds. None where there are too few to fit anything.
    """
    ours, theirs = _even(model), _even(frame)
    corners = cv2.goodFeaturesToTrack(ours, _MOST, _QUALITY, _BETWEEN_PX, mask=inside.astype(np.uint8), blockSize=5)
    if corners is None or len(corners) < _FEWEST:
        return None
    size = (_WINDOW, _WINDOW)
    there, good, _ = cv2.calcOpticalFlowPyrLK(ours, theirs, corners, corners.copy(), winSize=size, maxLevel=1)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(theirs, ours, there, there.copy(), winSize=size, maxLevel=1)
    away = np.hypot(*(back - corners).reshape(-1, 2).T)
    kept = (good.ravel() > 0) & (returned.ravel() > 0) & (away < _SAME_WAY_PX)
    if kept.sum() < _FEWEST:
        return None
    corner = np.array([box.left, box.top], np.float64)
    start, end = (
        (p.reshape(-1, 2)[kept].astype(np.float64) + 0.5) / HALF_STEP - 0.5 + corner for p in (corners, there)
    )
    places = motion.in_still(start)
    told = np.isfinite(places).all(axis=1)
    return Matches(places[told], end[told])


def _even(picture: Float) -> NDArray[np.uint8]:
    """Return a picture (height, width) with the same brightness and contrast everywhere, uint8."""
    mean = cv2.GaussianBlur(picture, (0, 0), _EVEN_PX)
    spread = np.sqrt(np.maximum(cv2.GaussianBlur(picture * picture, (0, 0), _EVEN_PX) - mean * mean, 0))
    return np.asarray(np.clip(128 + 40 * (picture - mean) / (spread + 4), 0, 255), np.uint8)
