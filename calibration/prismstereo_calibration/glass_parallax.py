"""What glass does to the disparity of rectified pictures: smooth, known, and taken away before depth is computed.

The maps are exact at one depth. At another, the disparity of a point is off by an amount that grows with the distance from
there in disparity, e = disparity - middle, and changes smoothly over the picture: e times a polynomial of fifth degree of the
pixel, and e squared times one of second degree. A few hundredths of a pixel behind a small prism, a third of a pixel at the
corners of a wide lens.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["GlassParallax"]

Array = NDArray[np.float64]
_POWERS = tuple((i, j) for i in range(6) for j in range(6 - i))  # of the column and the row, with e
_SQUARE_POWERS = tuple((i, j) for i in range(3) for j in range(3 - i))  # with e squared


@lru_cache(maxsize=8)
def _maps(parallax: GlassParallax) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the maps of a parallax, made once: they are the same for every frame."""
    return parallax.maps()


@dataclass(frozen=True, slots=True, eq=False)
class GlassParallax:
    """The pixels of disparity that a rectified pair lacks, as a polynomial of pixel and disparity.

    `factors` belong to `_POWERS` and `_SQUARE_POWERS`; columns and rows run from -1 to 1 over the picture, e over `half_px`.
    """

    factors: Array
    width: int
    height: int
    middle_px: float
    half_px: float

    @classmethod
    def fitted(
        cls, pixels: Array, disparity_px: Array, missing_px: Array, size: tuple[int, int], labels: int
    ) -> GlassParallax:
        """Fit what is missing (...) at left rectified pixels (..., 2) and disparities (...) of a picture of that size."""
        empty = cls(np.zeros(len(_POWERS) + len(_SQUARE_POWERS)), *size, (labels - 1) / 2, (labels - 3) / 2)
        known = np.isfinite(disparity_px) & np.isfinite(pixels).all(axis=-1)
        terms = empty._terms(pixels[known][:, 0], pixels[known][:, 1], disparity_px[known])
        factors = np.linalg.lstsq(np.stack(terms, axis=-1), missing_px[known], rcond=None)[0]
        return replace(empty, factors=np.asarray(factors, np.float64))

    def missing_px(self, disparity_px: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return what to add to a disparity map (height, width); NaN stays NaN."""
        linear, square = _maps(self)
        e = (disparity_px - np.float32(self.middle_px)) / np.float32(self.half_px)
        return np.asarray(e * (linear + e * square), np.float32)

    def maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return what e and its square are multiplied by at every pixel, (height, width) each."""
        x, y = self._scaled(np.arange(self.width)[None], np.arange(self.height)[:, None])
        linear, square = np.zeros((self.height, self.width)), np.zeros((self.height, self.width))
        for (i, j), factor in zip(_POWERS, self.factors, strict=False):
            linear += factor * x**i * y**j
        for (i, j), factor in zip(_SQUARE_POWERS, self.factors[len(_POWERS) :], strict=True):
            square += factor * x**i * y**j
        return linear.astype(np.float32), square.astype(np.float32)

    def _scaled(self, columns: NDArray[np.generic], rows: NDArray[np.generic]) -> tuple[Array, Array]:
        return 2 * np.asarray(columns, float) / (self.width - 1) - 1, 2 * np.asarray(rows, float) / (
            self.height - 1
        ) - 1

    def _terms(self, columns: Array, rows: Array, disparity_px: Array) -> list[Array]:
        x, y = self._scaled(columns, rows)
        e = (disparity_px - self.middle_px) / self.half_px
        return [e * x**i * y**j for i, j in _POWERS] + [e * e * x**i * y**j for i, j in _SQUARE_POWERS]
