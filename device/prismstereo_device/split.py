"""Split: one raw frame into its two views, upright, without copying what need not be copied."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.frame import RawFrame
from prismstereo_hw.view import View

__all__ = ["StereoPair", "split"]


@dataclass(frozen=True, slots=True)
class StereoPair:
    """Both views of one exposure, upright, (height, width) grey or (height, width, 3) BGR, as the sensor saw them."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    index: int
    timestamp_us: int
    lens_position: int | None = None


def split(frame: RawFrame, views: tuple[View, View]) -> StereoPair:
    """Cut the left and the right view out of a raw frame; any layout of rectangles, mirrored or turned."""
    left, right = (view.cut(frame.pixels) for view in views)
    return StereoPair(left, right, frame.index, frame.timestamp_us, frame.lens_position)
