"""Hole filling: a guess for narrow gaps, marked as one."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from msgspec import Meta

from prismstereo_device.filters.filter import Filter, Stage
from prismstereo_device.filters.filter_kernels import fill_rows
from prismstereo_device.filters.sheet import Sheet
from prismstereo_device.reasons import Reason

__all__ = ["Holes"]

# What lies there is known to be something else than what stands beside it, or is not in the picture at all.
_CLOSED = (Reason.OUTSIDE, Reason.SEAM, Reason.VIGNETTED, Reason.TOO_NEAR, Reason.TOO_FAR)


class Holes(Filter, frozen=True, kw_only=True, tag="holes"):
    """Fill gaps of at most `widest_px` with the farther of the two sides of their row.

    A gap is mostly what the nearer side hides from the other view, so it belongs to the farther one. What was filled has
    confidence 0 and keeps its reason for being unmatched; `Sheet.filled` marks it.
    """

    widest_px: Annotated[int, Meta(ge=1, le=16384)] = 32

    def stage(self) -> Stage:
        """Make the stage: it remembers nothing."""
        return self.apply

    def apply(self, sheet: Sheet) -> Sheet:
        """Fill, and mark what was filled."""
        closed = np.isin(sheet.reasons, _CLOSED) & np.isnan(sheet.disparity_px)
        full = np.empty_like(sheet.disparity_px)
        filled = np.zeros(full.shape, np.bool_)
        fill_rows(sheet.disparity_px, closed, self.widest_px, full, filled)
        return replace(sheet, disparity_px=full, filled=filled)
