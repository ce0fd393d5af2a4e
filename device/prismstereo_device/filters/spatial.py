"""Spatial filter: levels the noise of each surface, stops at depth edges, keeps slopes."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from msgspec import Meta

from prismstereo_device.filters.bands import in_bands
from prismstereo_device.filters.depth_edge import DepthEdge
from prismstereo_device.filters.filter import Stage
from prismstereo_device.filters.filter_kernels import level_rows
from prismstereo_device.filters.sheet import Sheet

__all__ = ["Spatial"]


class Spatial(DepthEdge, frozen=True, kw_only=True, tag="spatial"):
    """Replace each match by the mean of its surface within `radius_px`, in pairs that lie opposite each other."""

    radius_px: Annotated[int, Meta(ge=1, le=8)] = 2

    def stage(self) -> Stage:
        """Make the stage: it remembers nothing."""
        return self.apply

    def apply(self, sheet: Sheet) -> Sheet:
        """Level all matches; what is unmatched stays so."""
        height, width = sheet.disparity_px.shape
        radius = self.radius_px
        padded = np.full((height + 2 * radius, width + 2 * radius), np.nan, np.float32)
        padded[radius:-radius, radius:-radius] = sheet.disparity_px
        level = np.empty_like(sheet.disparity_px)
        reach = self.reach(sheet.window)
        in_bands(lambda first, end: level_rows(padded, radius, first, end, *reach, level), height, sheet.threads)
        return replace(sheet, disparity_px=level)
