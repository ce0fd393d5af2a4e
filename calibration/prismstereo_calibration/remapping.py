"""What the pictures are rectified by, whether it came from a board, with a scale, or from a scene, without one."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.view import View

__all__ = ["RemappedView", "Remapping"]


class RemappedView(Protocol):
    """One side of a remapping: it knows which part of the raw frame it is made of."""

    @property
    def view(self) -> View:
        """The view's place in the raw frame."""
        ...


Side = TypeVar("Side", bound=RemappedView)


class Remapping(Protocol[Side]):
    """Two rectified pictures of one size, made from the two views of raw frames of one size."""

    @property
    def left(self) -> Side:
        """The left side."""
        ...

    @property
    def right(self) -> Side:
        """The right side."""
        ...

    @property
    def width(self) -> int:
        """Width of a rectified picture in pixels."""
        ...

    @property
    def height(self) -> int:
        """Height of a rectified picture in pixels."""
        ...

    @property
    def frame_width(self) -> int:
        """Width of a raw frame in pixels."""
        ...

    @property
    def frame_height(self) -> int:
        """Height of one exposure of a raw frame in pixels."""
        ...

    @property
    def window(self) -> DisparityWindow:
        """Which disparities are searched, and what depths they stand for, if any."""
        ...

    def sources(self, side: Side) -> NDArray[np.float32]:
        """Return, for every rectified pixel, the pixel (height, width, 2) of the upright cut-out view; NaN outside of it."""
        ...
