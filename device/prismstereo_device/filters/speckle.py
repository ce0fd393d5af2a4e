"""Speckle filter: small islands of disparity that stand apart from all around them are false matches."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta

from prismstereo_device.filters.filter import Filter, Stage
from prismstereo_device.filters.sheet import Sheet
from prismstereo_device.filters.speckle_kernels import find_speckles
from prismstereo_device.reasons import Reason

__all__ = ["Speckle"]


class Speckle(Filter, frozen=True, kw_only=True, tag="speckle"):
    """Take islands of at most `largest_pixels` away; neighbours (4) belong together that differ by at most `step_px`.

    The same islands as `cv2.filterSpeckles` finds.
    """

    largest_pixels: Annotated[int, Meta(ge=1, le=1_000_000)] = 100
    step_px: Annotated[float, Meta(gt=0, le=64)] = 1.0

    def stage(self) -> Stage:
        """Make the stage: it remembers nothing."""
        return self.apply

    def apply(self, sheet: Sheet) -> Sheet:
        """Take the islands away, as `FILTERED`."""
        taken = np.zeros(sheet.disparity_px.shape, np.bool_)
        find_speckles(sheet.disparity_px, self.largest_pixels, np.float32(self.step_px), taken)
        return sheet.without(taken, Reason.FILTERED)
