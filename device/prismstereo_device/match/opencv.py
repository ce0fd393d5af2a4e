"""OpenCV's semi-global block matching behind the matcher interface."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.base import Matcher
from prismstereo_device.match.subpixel import refine

__all__ = ["SgbmMatcher"]

_BLOCK = 5
_P1 = 8 * _BLOCK**2
_P2 = 32 * _BLOCK**2
_UNIQUENESS_PERCENT = 10
_SPECKLE_PIXELS, _SPECKLE_RANGE = 100, 2
_CONSISTENT_PX = 1.0  # the match seen from the right may differ by this much
_TEXTURE_PX, _LEAST_TEXTURE = 11, 0.05  # window, mean squared grey levels per pixel
_STEPS = 16  # fixed-point steps per pixel in OpenCV's maps
_LABEL_STEP = 16
_SMALLEST_SIDE = 2 * _BLOCK


class SgbmMatcher(Matcher):
    """SGBM in three-way mode, run from both views.

    OpenCV leaves the first `labels` columns unmatched, which on half a frame is a large part of the picture: both
    pictures are widened by that much, and matches that fall outside are dropped. The second run, from the right view, is
    a true consistency check; what the two disagree on is not matched. Sub-pixel values come from `subpixel`: SGBM's own
    lock to whole pixels.
    """

    def disparity(self, left: NDArray[np.uint8], right: NDArray[np.uint8], labels: int) -> NDArray[np.float32]:
        """Find the disparity of grey pictures (height, width): float32 pixels, NaN where unmatched."""
        if min(left.shape) < _SMALLEST_SIDE:
            return np.full(left.shape, np.nan, np.float32)
        searched = -(-labels // _LABEL_STEP) * _LABEL_STEP
        seen_left = _sgbm(left, right, searched)
        seen_right = _sgbm(np.ascontiguousarray(right[:, ::-1]), np.ascontiguousarray(left[:, ::-1]), searched)[:, ::-1]
        columns = np.arange(left.shape[1], dtype=np.float32)
        partner = np.clip(np.rint(columns - seen_left), 0, left.shape[1] - 1).astype(np.intp)
        back = np.take_along_axis(seen_right, partner, axis=1)
        agrees = (back >= 0) & (np.abs(back - seen_left) <= _CONSISTENT_PX)
        kept = agrees & (seen_left >= 0) & (seen_left <= labels - 1) & _textured(left)
        refined = refine(left, right, np.where(kept, seen_left, np.float32(np.nan)))
        return np.minimum(refined, np.float32(labels - 1))


def _textured(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Tell where there is anything to match at all: black or saturated areas cost nothing at every disparity."""
    slope = cv2.filter2D(picture, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]], np.float32))
    return np.asarray(cv2.boxFilter(slope * slope, cv2.CV_32F, (_TEXTURE_PX, _TEXTURE_PX)) > _LEAST_TEXTURE)


def _sgbm(left: NDArray[np.uint8], right: NDArray[np.uint8], labels: int) -> NDArray[np.float32]:
    """Run SGBM on a pair widened to the left; (height, width) float32 pixels, negative where unmatched."""
    wide_left, wide_right = (
        cv2.copyMakeBorder(picture, 0, 0, labels, 0, cv2.BORDER_REPLICATE) for picture in (left, right)
    )
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=labels,
        blockSize=_BLOCK,
        P1=_P1,
        P2=_P2,
        disp12MaxDiff=1,
        preFilterCap=0,
        uniquenessRatio=_UNIQUENESS_PERCENT,
        speckleWindowSize=_SPECKLE_PIXELS,
        speckleRange=_SPECKLE_RANGE,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    steps = matcher.compute(wide_left, wide_right)[:, labels:]
    return np.asarray(steps, np.float32) / np.float32(_STEPS)
