"""The disparity map: what the matcher finds and the wire carries.

disparity = x_left - x_right >= 0 in rectified pixels of the left view; NaN where unmatched. Unmatched stays unmatched:
filling is a separate stage with its own mask.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow

__all__ = ["FRACTION", "DisparityMap"]

FRACTION = 16  # fixed-point steps per pixel inside matchers and on the wire


@dataclass(frozen=True, slots=True)
class DisparityMap:
    """Disparity of the left view, (height, width) float32 pixels, NaN where unmatched, and the window it was sought in.

    `confidence` (height, width) uint8: how clearly the match beats the second best, 0 (unmatched) to 255; None where the
    matcher does not tell. `reasons` (height, width) uint8: a `Reason` for every pixel; None where nobody asked. `filled`
    (height, width) bool: values that a filter put where nothing was matched; None where no filter did.
    """

    disparity_px: NDArray[np.float32]
    window: DisparityWindow
    confidence: NDArray[np.uint8] | None = None
    reasons: NDArray[np.uint8] | None = None
    filled: NDArray[np.bool_] | None = None

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Where there is a match, (height, width)."""
        return ~np.isnan(self.disparity_px)

    @property
    def density(self) -> float:
        """Share of matched pixels, 0..1; what was filled is not matched."""
        matched = self.valid if self.filled is None else self.valid & ~self.filled
        return float(np.count_nonzero(matched)) / self.disparity_px.size

    def depth(self) -> NDArray[np.float32]:
        """Depth along the rectified z axis in the calibration's unit (mm), NaN where unmatched."""
        return self.window.depth_map(self.disparity_px)

    def fixed_point(self) -> NDArray[np.uint16]:
        """Disparity in sixteenths of a pixel, 0 where unmatched: the form on the wire and in PNG files.

        A match at less than half a sixteenth would read as unmatched, so it is rounded up to one sixteenth.
        """
        steps = np.rint(np.nan_to_num(self.disparity_px, nan=0.0) * FRACTION)
        return np.where(self.valid, np.clip(steps, 1, 65535), 0).astype(np.uint16)

    @classmethod
    def from_fixed_point(cls, steps: NDArray[np.uint16], window: DisparityWindow) -> DisparityMap:
        """Make the map of sixteenths (height, width) uint16, 0 = unmatched."""
        pixels = steps.astype(np.float32) / np.float32(FRACTION)
        return cls(np.where(steps == 0, np.float32(np.nan), pixels), window)
