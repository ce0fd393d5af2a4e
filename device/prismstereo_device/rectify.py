"""Rectify: two remaps per frame, from maps built once."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.rectification import Rectification
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.split import StereoPair

__all__ = ["RectifiedPair", "Rectifier"]


@dataclass(frozen=True, slots=True)
class RectifiedPair:
    """Two grey pictures (height, width) uint8 whose rows correspond, and where each of them shows anything at all.

    `left_seen` and `right_seen` are (height, width) bool, or None where everything is seen.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    window: DisparityWindow
    left_seen: NDArray[np.bool_] | None = None
    right_seen: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True)
class _Maps:
    """Fixed-point remap tables of one view, and its mask."""

    whole: NDArray[np.int16]
    part: NDArray[np.uint16]
    seen: NDArray[np.bool_]

    @classmethod
    def of(cls, sources: NDArray[np.float32]) -> _Maps:
        seen = np.isfinite(sources[..., 0])
        filled = np.nan_to_num(sources, nan=-16.0)
        whole, part = cv2.convertMaps(filled[..., 0], filled[..., 1], cv2.CV_16SC2)
        return cls(np.asarray(whole, np.int16), np.asarray(part, np.uint16), seen)

    def apply(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.asarray(cv2.remap(pixels, self.whole, self.part, cv2.INTER_LINEAR), np.uint8)


class Rectifier:
    """Turns stereo pairs of one calibration into rectified pairs."""

    def __init__(self, rectification: Rectification) -> None:
        self.rectification = rectification
        self._left = _Maps.of(rectification.sources(rectification.left))
        self._right = _Maps.of(rectification.sources(rectification.right))

    def rectify(self, pair: StereoPair) -> RectifiedPair:
        """Rectify both views in grey; `window` carries the offset that the matched disparities will need."""
        return RectifiedPair(
            left=self._left.apply(_grey(pair.left)),
            right=self._right.apply(_grey(pair.right)),
            window=self.rectification.window,
            left_seen=self._left.seen,
            right_seen=self._right.seen,
        )

    def left_picture(self, pair: StereoPair) -> NDArray[np.uint8]:
        """Rectify the left view with its colours, (height, width[, 3]): what a cloud or a picture is painted with."""
        return self._left.apply(np.ascontiguousarray(pair.left))


def _grey(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    pixels = np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8) if pixels.ndim == 3 else pixels
