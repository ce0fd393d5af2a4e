"""What every matcher is, and the checks and masks that all of them share."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.rectify import RectifiedPair
from prismstereo_hw.errors import ImageError, UsageError

__all__ = ["Matcher"]

_MOST_LABELS = 1024
_LARGEST_SIDE_PX = 16384


class Matcher(ABC):
    """Finds disparities 0 .. labels - 1 of the left picture of a rectified pair."""

    def match(self, pair: RectifiedPair) -> DisparityMap:
        """Match a pair: (height, width) float32 pixels, NaN where unmatched.

        Nothing is matched outside of what both views show. `ImageError` for pictures that do not belong together.
        """
        _check(pair)
        found = self.disparity(pair.left, pair.right, pair.window.labels)
        return DisparityMap(_within(found, pair), pair.window)

    @abstractmethod
    def disparity(self, left: NDArray[np.uint8], right: NDArray[np.uint8], labels: int) -> NDArray[np.float32]:
        """Find the disparity of checked grey pictures (height, width): float32 pixels, NaN where unmatched."""


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


def _within(found: NDArray[np.float32], pair: RectifiedPair) -> NDArray[np.float32]:
    """Drop matches whose partner lies outside the right picture, or where either view shows nothing."""
    columns = np.arange(found.shape[1], dtype=np.float32)
    with np.errstate(invalid="ignore"):
        partner = columns - found
        kept = partner >= 0
        if pair.left_seen is not None:
            kept &= pair.left_seen
        if pair.right_seen is not None:
            at = np.where(kept, np.rint(np.nan_to_num(partner)), 0).astype(np.intp)
            kept &= np.take_along_axis(pair.right_seen, at, axis=1)
    return np.where(kept, found, np.float32(np.nan))
