"""What of a frame is wanted: a rectangle of the rectified left picture, and a range of depths."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.measuring.patch import Patch
from prismstereo_hw.errors import UsageError

__all__ = ["Gates"]


@dataclass(frozen=True, slots=True)
class Gates:
    """Depths from `near` to `far` in the calibration's unit (mm), seen in `region` (None: anywhere), are kept."""

    near: float = 0.0
    far: float = math.inf
    region: Patch | None = None

    def __post_init__(self) -> None:
        """Refuse a range without depths."""
        if not 0 <= self.near < self.far:
            raise UsageError(f"depths from {self.near:g} to {self.far:g}: give near < far, neither of them negative")

    def keep(self, depth: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Tell which pixels (height, width) of a depth map pass; `UsageError` where the region is not inside of it."""
        kept = np.isfinite(depth) & (depth > 0) & (depth >= self.near) & (depth <= self.far)
        if self.region is None:
            return kept
        height, width = depth.shape
        one = self.region
        if one.x < 0 or one.y < 0 or one.right > width or one.bottom > height:
            raise UsageError(f"{one} reaches out of the map of {width}x{height}: give pixels of the rectified picture")
        inside = np.zeros_like(kept)
        inside[one.y : one.bottom, one.x : one.right] = True
        return np.asarray(kept & inside)
