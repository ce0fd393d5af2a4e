"""What every matcher is, and the checks, masks and settings that all of them share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.match.mask_kernels import settle
from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.reasons import Reason
from prismstereo_device.rectify import RectifiedPair
from prismstereo_hw.errors import ImageError, UsageError

__all__ = ["Found", "Matcher", "Search"]

_MOST_LABELS = 1024
_LARGEST_SIDE_PX = 16384
Grey = NDArray[np.uint8]
_AS_USUAL = MatchSettings()
_EVERYWHERE = np.ones((1, 1), np.bool_)


@dataclass(frozen=True, slots=True)
class Search:
    """What a matcher is to do: disparities `first` .. `labels` - 1 of checked pictures, with so many threads.

    `hint` is the last map of a video (height, width) float32, NaN where unmatched, or None; it may help, never harm.
    """

    labels: int
    first: int = 0
    threads: int = 2
    hint: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True)
class Found:
    """What a matcher found: disparity (height, width) float32 pixels, NaN where unmatched.

    `confidence` (height, width) uint8 where the matcher tells, and `reasons` (height, width) uint8, see `reasons.Reason`.
    """

    disparity_px: NDArray[np.float32]
    confidence: NDArray[np.uint8] | None = None
    reasons: NDArray[np.uint8] | None = None


class Matcher(ABC):
    """Finds disparities of the left picture of a rectified pair."""

    def __init__(self, settings: MatchSettings = _AS_USUAL) -> None:
        self.settings = settings

    def match(self, pair: RectifiedPair, hint: DisparityMap | None = None) -> DisparityMap:
        """Match a pair: (height, width) float32 pixels, NaN where unmatched.

        Nothing is matched outside of what both views show, nor outside of the region. `hint` is the map of the frame before.
        `ImageError` for pictures that do not belong together, `UsageError` for a search that cannot be.
        """
        _check(pair)
        region, settings = self._region(pair), self.settings
        if settings.first_px >= pair.window.labels:
            raise UsageError(
                f"the search begins at {settings.first_px}, but the range has {pair.window.labels} labels: begin below"
            )
        before = None if hint is None or hint.disparity_px.shape != pair.left.shape else hint.disparity_px
        y, height = region[1], region[3]
        rows = slice(y, y + height)  # all columns: a match needs the right picture to the left of the region
        found = self.search(
            np.ascontiguousarray(pair.left[rows]),
            np.ascontiguousarray(pair.right[rows]),
            Search(pair.window.labels, settings.first_px, settings.threads, None if before is None else before[rows]),
        )
        return self._placed(pair, region, found)

    @abstractmethod
    def search(self, left: Grey, right: Grey, search: Search) -> Found:
        """Search checked grey pictures (height, width)."""

    def _region(self, pair: RectifiedPair) -> tuple[int, int, int, int]:
        height, width = pair.left.shape
        if self.settings.region is None:
            return 0, 0, width, height
        x, y, w, h = self.settings.region
        if x + w > width or y + h > height:
            raise UsageError(
                f"region {x},{y} {w}x{h} leaves the rectified picture of {width}x{height}: give one inside"
            )
        return x, y, w, h

    def _placed(self, pair: RectifiedPair, region: tuple[int, int, int, int], found: Found) -> DisparityMap:
        """Put what was found in the region's rows back, drop what lies outside, and round to the asked sub-pixel bits."""
        x, y, w, h = region
        rows, columns = slice(y, y + h), slice(x, x + w)
        disparity = np.full(pair.left.shape, np.nan, np.float32)
        disparity[rows, columns] = found.disparity_px[:, columns]
        left_seen, right_seen = (_EVERYWHERE if seen is None else seen for seen in (pair.left_seen, pair.right_seen))
        settle(disparity, left_seen, right_seen, np.float32(2**self.settings.subpixel_bits))
        unmatched = np.isnan(disparity)
        confidence = None
        if found.confidence is not None:
            confidence = np.zeros(pair.left.shape, np.uint8)
            confidence[rows, columns] = found.confidence[:, columns]
            confidence[unmatched] = 0
        reasons = None
        if found.reasons is not None:
            reasons = np.full(pair.left.shape, Reason.OUTSIDE, np.uint8)
            reasons[rows, columns] = found.reasons[:, columns]
            reasons = np.where(unmatched & (reasons == Reason.MATCHED), np.uint8(Reason.OUTSIDE), reasons)
        return DisparityMap(disparity, pair.window, confidence, reasons)


def _check(pair: RectifiedPair) -> None:
    left, right = pair.left, pair.right
    for picture in (left, right):
        if picture.ndim != 2 or picture.dtype != np.uint8 or not picture.size or max(picture.shape) > _LARGEST_SIDE_PX:
            raise ImageError(
                f"a matcher takes 8-bit grey pictures of at most {_LARGEST_SIDE_PX} pixels a side, not {picture.dtype} "
                f"{picture.shape}"
            )
    if left.shape != right.shape:
        raise ImageError(
            f"the left picture is {left.shape[1]}x{left.shape[0]} and the right one {right.shape[1]}x{right.shape[0]}: "
            "a rectified pair has one size"
        )
    for seen in (pair.left_seen, pair.right_seen):
        if seen is not None and (seen.shape != left.shape or seen.dtype != np.bool_):
            raise ImageError(
                f"a mask is {seen.dtype} {seen.shape}, but the pictures are {left.shape}: give bool, same size"
            )
    if not 1 <= pair.window.labels <= _MOST_LABELS:
        raise UsageError(f"--max-disparity {pair.window.labels}: search between 1 and {_MOST_LABELS} disparities")
