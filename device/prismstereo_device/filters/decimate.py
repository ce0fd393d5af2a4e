"""Decimate: a smaller map that loses no obstacle."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.filters.filter import Filter, Stage
from prismstereo_device.filters.filter_kernels import closest_of_blocks
from prismstereo_device.filters.sheet import Sheet

__all__ = ["Decimate"]


class Decimate(Filter, frozen=True, kw_only=True, tag="decimate"):
    """Make one pixel of each block of `factor` x `factor`: the closest, which is the largest disparity.

    A row or column of blocks that the picture cuts short counts as a whole one, so that pixel x of the small map has its middle
    at pixel factor * (x + 0.5) - 0.5 of the large one.
    """

    factor: Annotated[int, Meta(ge=2, le=8)] = 2

    def stage(self) -> Stage:
        """Make the stage: it remembers nothing."""
        return self.apply

    def apply(self, sheet: Sheet) -> Sheet:
        """Make the small map. Its disparities are in small pixels, and its window makes the same depths of them.

        Glass bends the disparity of each pixel of the large map by a known amount, which is taken off beforehand.
        """
        large, window = sheet.disparity_px, sheet.window
        if window.glass is not None and large.shape == (window.glass.height, window.glass.width):
            large = np.maximum(large + window.glass.missing_px(large), np.float32(0))
        shape = tuple(-(-side // self.factor) for side in large.shape)
        small = np.empty(shape, np.float32)
        confidence, reasons = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
        closest_of_blocks(large, sheet.confidence, sheet.reasons, self.factor, small, confidence, reasons)
        return replace(
            sheet,
            disparity_px=np.asarray(small / np.float32(self.factor), np.float32),
            confidence=confidence,
            reasons=reasons,
            window=self._small(window),
            picture=None if sheet.picture is None else self._shrunk(sheet.picture),
        )

    def _small(self, window: DisparityWindow) -> DisparityWindow:
        labels = -(-(window.labels - 2) // self.factor) + 2  # the near end stays one pixel below the last label
        return DisparityWindow(labels, window.offset_px / self.factor, window.scale_px / self.factor)

    def _shrunk(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the mean grey level of each block."""
        height, width = picture.shape
        rows, columns = -(-height // self.factor), -(-width // self.factor)
        whole = cv2.copyMakeBorder(
            picture, 0, rows * self.factor - height, 0, columns * self.factor - width, cv2.BORDER_REPLICATE
        )
        return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
