"""Rectify: two remaps per frame, from maps built once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.remapping import Remapping
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.split import StereoPair
from prismstereo_hw.errors import ImageError

__all__ = ["RectifiedPair", "Rectifier"]

Made = TypeVar("Made", bound=Remapping[Any])  # each kind of rectification asks for its own kind of side

_NOWHERE = -16.0  # a source pixel far enough outside to be black
_RIM = 7  # a matching window at the rim of a view would reach over what is not there: half of it is not seen


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
    """Remap tables of one view, (height, width) float32 columns and rows, and its mask.

    Floating-point tables: exact, and with OpenCV 5 quicker than its fixed-point ones.
    """

    columns: NDArray[np.float32]
    rows: NDArray[np.float32]
    seen: NDArray[np.bool_]

    @classmethod
    def of(cls, sources: NDArray[np.float32]) -> _Maps:
        shown = np.isfinite(sources[..., 0]).astype(np.uint8)
        seen = cv2.erode(shown, np.ones((_RIM, _RIM), np.uint8), borderValue=1).astype(bool)
        filled = np.nan_to_num(sources, nan=_NOWHERE)
        return cls(np.ascontiguousarray(filled[..., 0]), np.ascontiguousarray(filled[..., 1]), seen)

    def apply(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.asarray(cv2.remap(pixels, self.columns, self.rows, cv2.INTER_LINEAR), np.uint8)


class Rectifier(Generic[Made]):
    """Turns stereo pairs of one unit into rectified pairs, by a rectification with or without a scale."""

    def __init__(self, rectification: Made) -> None:
        self.rectification = rectification
        self._left = _Maps.of(rectification.sources(rectification.left))
        self._right = _Maps.of(rectification.sources(rectification.right))

    def rectify(self, pair: StereoPair) -> RectifiedPair:
        """Rectify both views in grey; `window` carries the offset that the matched disparities will need.

        `ImageError` for views of another size than those that were calibrated.
        """
        self._require(pair)
        return RectifiedPair(
            left=self._left.apply(_grey(pair.left)),
            right=self._right.apply(_grey(pair.right)),
            window=self.rectification.window,
            left_seen=self._left.seen,
            right_seen=self._right.seen,
        )

    def _require(self, pair: StereoPair) -> None:
        frame = self.rectification.frame_width, self.rectification.frame_height
        for side, picture, made_for in (
            ("left", pair.left, self.rectification.left.view.upright_size(*frame)),
            ("right", pair.right, self.rectification.right.view.upright_size(*frame)),
        ):
            height, width = picture.shape[:2]
            if (width, height) != made_for:
                raise ImageError(
                    f"the {side} view is {width}x{height}, but this rectification is for {made_for[0]}x{made_for[1]}: "
                    "split frames of the calibrated size"
                )

    def left_picture(self, pair: StereoPair) -> NDArray[np.uint8]:
        """Rectify the left view with its colours, (height, width[, 3]): what a cloud or a picture is painted with."""
        self._require(pair)
        return self._left.apply(np.ascontiguousarray(pair.left))


def _grey(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    pixels = np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8) if pixels.ndim == 3 else pixels
