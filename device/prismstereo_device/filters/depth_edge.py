"""What counts as a depth edge: a jump in disparity that no filter averages across.

A jump is an edge where it is more than `edge_px` labels or more than `edge_percent` of the whole parallax, which is disparity
plus the window's offset and goes as one over depth. Less than a quarter pixel cannot be told from noise and is no edge.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.filters.filter import Filter

__all__ = ["DepthEdge", "Reach"]

_NOISE_PX = 0.25


class Reach(NamedTuple):
    """What kernels work a tolerance out of: min(most_px, max(least_px, share * (disparity + offset_px)))."""

    most_px: np.float32
    least_px: np.float32
    share: np.float32
    offset_px: np.float32


class DepthEdge(Filter, frozen=True, kw_only=True):
    """The settings of a filter that stops at depth edges."""

    edge_px: Annotated[float, Meta(gt=0, le=64)] = 1.0
    edge_percent: Annotated[float, Meta(gt=0, le=100)] = 2.0

    def reach(self, window: DisparityWindow) -> Reach:
        """Return how far two disparities of one surface may be apart in a window."""
        return Reach(
            np.float32(self.edge_px),
            np.float32(min(_NOISE_PX, self.edge_px)),
            np.float32(self.edge_percent / 100),
            np.float32(window.offset_px),
        )
