"""Making pictures fit a model's size, and its disparity the pictures' size again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.learned.convention import Convention
from prismstereo_device.match.learned.model_shape import ModelShape
from prismstereo_hw.errors import UsageError

__all__ = ["Fitting"]

_EDGE_PX = 1.0  # three pixels that differ by more lie on two surfaces: what is between belongs to neither


@dataclass(frozen=True, slots=True)
class Fitting:
    """Pictures of `height` x `width`, and what the model is given: `model_height` x `model_width`, padded or resized."""

    height: int
    width: int
    model_height: int
    model_width: int
    resized: bool

    @classmethod
    def plan(cls, height: int, width: int, shape: ModelShape, convention: Convention) -> Fitting:
        """Choose the size the model works at; `UsageError` where padding is wished and the picture is larger."""
        step = math.lcm(convention.multiple, 2) if shape.halved else convention.multiple
        model_height = _side(height, shape.height, step)
        model_width = _side(width, shape.width, step)
        roomy = model_height >= height and model_width >= width
        if convention.fit == "pad" and not roomy:
            raise UsageError(
                f"the pictures of {width}x{height} are larger than the model's {model_width}x{model_height}: padding cannot "
                "help, use fit=resize"
            )
        resized = convention.fit == "resize" or not roomy
        return cls(height, width, model_height, model_width, resized)

    @property
    def magnification(self) -> float:
        """Disparity of the pictures over that of the model."""
        return self.width / self.model_width if self.resized else 1.0

    def picture(self, grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Make a picture (height, width) fit; what is padded repeats the last row and column."""
        if not self.resized:
            below, right = self.model_height - self.height, self.model_width - self.width
            return np.asarray(cv2.copyMakeBorder(grey, 0, below, 0, right, cv2.BORDER_REPLICATE), np.uint8)
        return np.asarray(resized(grey, self.model_height, self.model_width), np.uint8)

    def disparity(self, found: NDArray[np.float32]) -> NDArray[np.float32]:
        """Bring the model's disparity (model_height, model_width) back to the pictures' size and pixels."""
        if not self.resized:
            return found[: self.height, : self.width]
        size = (self.width, self.height)
        smooth = np.asarray(cv2.resize(found, size, interpolation=cv2.INTER_LINEAR), np.float32)
        nearest = np.asarray(cv2.resize(found, size, interpolation=cv2.INTER_NEAREST_EXACT), np.float32)
        edge = cv2.resize(_edges(found), size, interpolation=cv2.INTER_NEAREST_EXACT) > 0
        return np.where(edge | np.isnan(smooth), nearest, smooth) * np.float32(self.magnification)


def resized(grey: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """Resize a picture; what shrinks is averaged."""
    shrinks = height < grey.shape[0] or width < grey.shape[1]
    way = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(grey, (width, height), interpolation=way), np.uint8)


def _edges(found: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Mark the pixels of a map whose 3x3 surroundings hold more than one surface."""
    known = np.isfinite(found)
    around = np.ones((3, 3), np.uint8)
    highest = cv2.dilate(np.where(known, found, np.float32(-np.inf)), around)
    lowest = cv2.erode(np.where(known, found, np.float32(np.inf)), around)
    return np.asarray(highest > lowest + np.float32(_EDGE_PX), np.uint8)


def _side(picture: int, fixed: int | None, step: int) -> int:
    return fixed if fixed is not None else -(-picture // step) * step
