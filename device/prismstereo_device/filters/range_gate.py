"""Range gate: only what lies between two depths stays."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta

from prismstereo_device.filters.filter import Filter, Stage
from prismstereo_device.filters.sheet import Sheet
from prismstereo_device.reasons import Reason
from prismstereo_hw.errors import UsageError

__all__ = ["RangeGate"]


class RangeGate(Filter, frozen=True, kw_only=True, tag="range"):
    """Keep depths from `near_mm` to `far_mm` (may be inf) along the rectified z axis, in the calibration's unit."""

    near_mm: Annotated[float, Meta(ge=0)] = 0.0
    far_mm: Annotated[float, Meta(gt=0)] = math.inf

    def __post_init__(self) -> None:
        """Refuse an empty gate."""
        if not self.near_mm < self.far_mm:
            raise UsageError(f"the gate {self.near_mm:g}:{self.far_mm:g} mm is empty: give near_mm below far_mm")

    def stage(self) -> Stage:
        """Make the stage: it remembers nothing."""
        return self.apply

    def apply(self, sheet: Sheet) -> Sheet:
        """Take what is nearer or farther away; `UsageError` for a pair that has no depth."""
        window = sheet.window
        if window.scale_px <= 0:
            raise UsageError(
                f"a range filter of {self.near_mm:g}:{self.far_mm:g} mm needs depth, but this pair has no focal length and "
                "baseline: leave the filter out, or match with a calibration"
            )
        seen = sheet.disparity_px
        if window.glass is not None and seen.shape == (window.glass.height, window.glass.width):
            seen = seen + window.glass.missing_px(seen)
        with np.errstate(invalid="ignore"):  # NaN is neither
            if self.near_mm > 0:
                nearer = seen > np.float32(window.scale_px / self.near_mm - window.offset_px)
                sheet = sheet.without(nearer, Reason.TOO_NEAR)
            if math.isfinite(self.far_mm):
                farther = seen < np.float32(window.scale_px / self.far_mm - window.offset_px)
                sheet = sheet.without(farther, Reason.TOO_FAR)
        return sheet
