"""OpenCV's matchers behind the matcher interface: semi-global from both views, semi-global in one pass, and blocks.

OpenCV leaves as many columns at the left unmatched as it searches disparities, which on half a frame is a large part of the
picture: all pictures are widened by that much here, and matches that fall outside are dropped. Searches begin at 0 whatever was
asked for: with its own disparity out of reach, a pixel would take the next best for a match.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.base import Found, Grey, Matcher, Search
from prismstereo_device.match.subpixel import refine
from prismstereo_device.reasons import Reason

__all__ = ["BlockMatcher", "SgbmMatcher", "ThreeWayMatcher"]

_BLOCK = 5
_P1 = 8 * _BLOCK**2
_P2 = 32 * _BLOCK**2
_UNIQUENESS_PERCENT = 10
_SPECKLE_PIXELS, _SPECKLE_PX = 100, 2
_CONSISTENT_PX = 1  # the match seen from the right may differ by this much
_TEXTURE_PX, _LEAST_TEXTURE = 11, 0.05  # window, mean squared grey levels per pixel
_STEPS = 16  # fixed-point steps per pixel in OpenCV's maps
_LABEL_STEP = 16
_SMALLEST_SIDE = 2 * _BLOCK
_WINDOW = 15  # of block matching
_RIM = _WINDOW // 2 + 1


class SgbmMatcher(Matcher):
    """SGBM in three-way mode, run from both views.

    The second run, from the right view, is a true consistency check; what the two disagree on is not matched. Sub-pixel
    values come from `subpixel`: SGBM's own lock to whole pixels.
    """

    def search(self, left: Grey, right: Grey, search: Search) -> Found:
        """Search grey pictures (height, width)."""
        labels = search.labels
        if min(left.shape) < _SMALLEST_SIDE:
            return _nothing(left)
        with _threads(search.threads):
            seen_left = _sgbm(left, right, labels)
            seen_right = _sgbm(_mirrored(right), _mirrored(left), labels)[:, ::-1]
            columns = np.arange(left.shape[1], dtype=np.float32)
            partner = np.clip(np.rint(columns - seen_left), 0, left.shape[1] - 1).astype(np.intp)
            back = np.take_along_axis(seen_right, partner, axis=1)
            agrees = (back >= 0) & (np.abs(back - seen_left) <= _CONSISTENT_PX)
            textured = _textured(left)
            kept = agrees & (seen_left >= search.first) & (seen_left <= labels - 1) & textured
            refined = refine(left, right, np.where(kept, seen_left, np.float32(np.nan)))
        reasons = np.full(left.shape, Reason.UNMATCHED, np.uint8)
        reasons[seen_left > labels - 1] = Reason.TOO_NEAR
        reasons[(seen_left >= 0) & (seen_left < search.first)] = Reason.TOO_FAR
        reasons[(seen_left >= 0) & ~agrees] = Reason.OCCLUDED
        reasons[~textured] = Reason.WEAK_TEXTURE
        reasons[kept] = Reason.MATCHED
        return Found(np.clip(refined, np.float32(search.first), np.float32(labels - 1)), reasons=reasons)


class ThreeWayMatcher(Matcher):
    """SGBM in three-way mode as OpenCV has it: one pass, its own consistency check, its own sub-pixel values."""

    def search(self, left: Grey, right: Grey, search: Search) -> Found:
        """Search grey pictures (height, width)."""
        if min(left.shape) < _SMALLEST_SIDE:
            return _nothing(left)
        with _threads(search.threads):
            return _judged(left, _sgbm(left, right, search.labels), search)


class BlockMatcher(Matcher):
    """Block matching as OpenCV has it: sums of absolute differences over 15x15 pixels of the Sobel pictures."""

    def search(self, left: Grey, right: Grey, search: Search) -> Found:
        """Search grey pictures (height, width)."""
        with _threads(search.threads):
            return _judged(left, _blocks(left, right, search.labels), search)


def _judged(left: Grey, seen: NDArray[np.float32], search: Search) -> Found:
    """Keep what was asked for of a map (height, width) in which what is unmatched is negative."""
    textured = _textured(left)
    kept = (seen >= search.first) & (seen <= search.labels - 1) & textured
    reasons = np.full(left.shape, Reason.UNMATCHED, np.uint8)
    reasons[seen > search.labels - 1] = Reason.TOO_NEAR
    reasons[(seen >= 0) & (seen < search.first)] = Reason.TOO_FAR
    reasons[~textured] = Reason.WEAK_TEXTURE
    reasons[kept] = Reason.MATCHED
    return Found(np.where(kept, seen, np.float32(np.nan)), reasons=reasons)


def _nothing(left: Grey) -> Found:
    return Found(np.full(left.shape, np.nan, np.float32), reasons=np.full(left.shape, Reason.UNMATCHED, np.uint8))


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Let OpenCV use so many threads for a while; its results do not depend on it."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def _mirrored(picture: Grey) -> Grey:
    return np.ascontiguousarray(picture[:, ::-1])


def _textured(picture: Grey) -> NDArray[np.bool_]:
    """Tell where there is anything to match at all: black or saturated areas cost nothing at every disparity."""
    slope = cv2.filter2D(picture, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]], np.float32))
    return np.asarray(cv2.boxFilter(slope * slope, cv2.CV_32F, (_TEXTURE_PX, _TEXTURE_PX)) > _LEAST_TEXTURE)


def _searched(labels: int) -> int:
    """Return how many disparities OpenCV is to search: whole sixteens."""
    return -(-labels // _LABEL_STEP) * _LABEL_STEP


def _sgbm(left: Grey, right: Grey, labels: int) -> NDArray[np.float32]:
    """Run SGBM on a widened pair; (height, width) float32 pixels, negative where unmatched."""
    searched = _searched(labels)
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=searched,
        blockSize=_BLOCK,
        P1=_P1,
        P2=_P2,
        disp12MaxDiff=_CONSISTENT_PX,
        preFilterCap=0,
        uniquenessRatio=_UNIQUENESS_PERCENT,
        speckleWindowSize=_SPECKLE_PIXELS,
        speckleRange=_SPECKLE_PX,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    wide = [cv2.copyMakeBorder(picture, 0, 0, searched, 0, cv2.BORDER_REPLICATE) for picture in (left, right)]
    return np.asarray(matcher.compute(*wide)[:, searched:], np.float32) / np.float32(_STEPS)


def _blocks(left: Grey, right: Grey, labels: int) -> NDArray[np.float32]:
    """Run block matching on a pair with a rim all around; (height, width) float32 pixels, negative where unmatched."""
    searched = _searched(labels)
    matcher = cv2.StereoBM.create(searched, _WINDOW)
    matcher.setDisp12MaxDiff(_CONSISTENT_PX)
    matcher.setSpeckleWindowSize(_SPECKLE_PIXELS)
    matcher.setSpeckleRange(_SPECKLE_PX * _STEPS)  # in sixteenths here, unlike SGBM's
    margin = searched + _RIM
    wide = [cv2.copyMakeBorder(picture, _RIM, _RIM, margin, _RIM, cv2.BORDER_REPLICATE) for picture in (left, right)]
    return np.asarray(matcher.compute(*wide)[_RIM:-_RIM, margin:-_RIM], np.float32) / np.float32(_STEPS)
