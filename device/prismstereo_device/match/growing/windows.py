"""A pair of pictures with a margin around it, laid out flat for the loops, and the sums over each pixel's window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.growing.growing_kernels import MARGIN_PX

__all__ = ["PaddedPair", "Windows"]

S = TypeVar("S", bound=np.generic)

_SIDES = (MARGIN_PX,) * 4


@dataclass(frozen=True, slots=True)
class Windows:
    """Sums over the square window of each pixel of left and right, by which windows are correlated.

    `sums` (2, pixels) int32: grey levels. `powers` (2, pixels) int32: squared deviations times the pixels of a window.
    `floor`: what noise alone adds to the powers of two windows. `half_px`: the window has 2 half_px + 1 pixels a side.
    """

    half_px: int
    sums: NDArray[np.int32]
    powers: NDArray[np.int32]
    floor: float


@dataclass(frozen=True, slots=True)
class PaddedPair:
    """Left and right, mirrored at their borders by `MARGIN_PX`: `pictures` (2, height * width) uint8 with the margin."""

    pictures: NDArray[np.uint8]
    height: int
    width: int

    @classmethod
    def of(cls, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> PaddedPair:
        """Lay out two grey pictures (height, width) of one size."""
        height, width = left.shape[0] + 2 * MARGIN_PX, left.shape[1] + 2 * MARGIN_PX
        pictures = np.empty((2, height * width), np.uint8)
        for view, picture in enumerate((left, right)):
            pictures[view] = np.ravel(cv2.copyMakeBorder(picture, *_SIDES, cv2.BORDER_REFLECT_101))
        return cls(pictures, height, width)

    def windows(self, half_px: int, noise_grey: float) -> Windows:
        """Sum up the windows; windows that reach over the margin are not to be used."""
        side = 2 * half_px + 1
        sums = np.empty(self.pictures.shape, np.int32)
        powers = np.empty(self.pictures.shape, np.int32)
        for view, picture in enumerate(self.pictures.reshape(2, self.height, self.width)):
            grey = picture.astype(np.float32)  # whole numbers below 2^24: exact
            total, squares = (
                np.asarray(cv2.boxFilter(values, cv2.CV_32F, (side, side), normalize=False)).ravel().astype(np.int32)
                for values in (grey, grey * grey)
            )
            sums[view] = total
            powers[view] = side * side * squares - total * total
        return Windows(half_px, sums, powers, 2.0 * side**4 * noise_grey**2)

    def inner(self, flat: NDArray[S]) -> NDArray[S]:
        """Return (height, width) of the pictures without margin from values of every pixel with it."""
        m = MARGIN_PX
        return np.ascontiguousarray(flat.reshape(self.height, self.width)[m:-m, m:-m])
