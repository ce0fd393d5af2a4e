"""Clean: the confidence-weighted median beside depth edges, where matchers err.

A matching window that reaches over an edge takes the nearer disparity with it, by a few pixels. The median of matches of one
brightness puts the edge back to where the picture has it, and, unlike a mean, never makes a depth between the two.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from prismstereo_device.filters.bands import in_bands
from prismstereo_device.filters.depth_edge import DepthEdge
from prismstereo_device.filters.filter import Stage
from prismstereo_device.filters.filter_kernels import mark_edges
from prismstereo_device.filters.median_kernels import median_rows
from prismstereo_device.filters.sheet import Sheet

__all__ = ["Clean"]

_RADIUS_WITHOUT_PICTURE_PX = 2  # with nothing to tell surfaces apart, a large median rounds corners off
_DENSE_UP_TO_PX = 3  # larger windows have every second pixel: as good, and quicker
_MARGIN_PX = 3  # beside an edge: half a matching window
_MOST_WEIGHT = 255


class Clean(DepthEdge, frozen=True, kw_only=True, tag="clean"):
    """Replace matches beside a depth edge or a gap that lie on another surface than the weighted median of their window.

    The window reaches `radius_px` around the match. Matches weigh by confidence and, with the picture, by how like the middle
    they are: exp(-(difference in grey levels)^2 / (2 sigma_grey^2)).
    """

    radius_px: Annotated[int, Meta(ge=1, le=16)] = 4
    sigma_grey: Annotated[float, Meta(gt=0, le=255)] = 12.0

    def stage(self) -> Stage:
        """Make the stage: it remembers nothing."""
        return self.apply

    def apply(self, sheet: Sheet) -> Sheet:
        """Clean the matches beside edges; what is unmatched stays so."""
        picture, radius = sheet.picture, self.radius_px
        if picture is None:
            picture, radius = np.zeros(sheet.reasons.shape, np.uint8), min(radius, _RADIUS_WITHOUT_PICTURE_PX)
        doubtful = self._doubtful(sheet)
        clean, confidence = np.empty_like(sheet.disparity_px), np.empty_like(sheet.confidence)
        stride = 1 if radius <= _DENSE_UP_TO_PX else 2
        span = radius - radius % stride  # whole strides, so that the middle is one of the samples

        def work(first: int, end: int) -> None:
            median_rows(
                sheet.disparity_px, sheet.confidence, picture, self._alike(), doubtful, *self.reach(sheet.window), span,
                stride, first, end, clean, confidence,
            )  # fmt: skip

        in_bands(work, clean.shape[0], sheet.threads)
        return replace(sheet, disparity_px=clean, confidence=confidence)

    def _doubtful(self, sheet: Sheet) -> NDArray[np.uint8]:
        edge = np.zeros(sheet.reasons.shape, np.uint8)
        mark_edges(sheet.disparity_px, *self.reach(sheet.window), edge)
        return np.asarray(cv2.dilate(edge, np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)), np.uint8)

    def _alike(self) -> NDArray[np.int32]:
        difference = np.arange(256)
        likeness = np.exp(-(difference**2) / (2 * self.sigma_grey**2))
        return np.asarray(np.rint(_MOST_WEIGHT * likeness), np.int32)
