"""Where low-resolution sites lie in a still: scale and translation per axis, right to half a pixel.

Pixel 0 is the centre of the first pixel in both pictures: a still pixel x lies at u = (x - shift + 0.5) / scale - 0.5 of the
low-resolution map. A *site* is a low-resolution pixel's centre, a *cell* the square between four of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError

__all__ = ["Axis", "Grid"]

Int = NDArray[np.int32]
_LARGEST_SCALE = 64.0
_SLACK = 1e-9  # what rounding may take from a pixel that lies exactly at the rim


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis of a grid, worked out for its sizes: `sites_given` sites, taken as `low`, two at least; `high` still pixels.

    Pixels `first` to `end` - 1 are those that the low-resolution picture covers. `cell` (high,) is the cell that a pixel is
    in, 0 .. low - 2, and `part` (high,) float32 how far into it, -0.5 .. 1.5, beyond 0 .. 1 at the rim only. `starts` (low,)
    are the first pixels of the cells and the end of the last. `sites` (low,) are the pixels at or just before the sites.
    """

    sites_given: int
    low: int
    high: int
    first: int
    end: int
    cell: Int
    part: NDArray[np.float32]
    starts: Int
    sites: Int
    scale: float
    shift_px: float

    def pixels_at(self, places: NDArray[np.float64]) -> Int:
        """Return the still pixels nearest to places given in sites, drawn in where the still ends: int32, same shape."""
        pixels = np.floor((places + 0.5) * self.scale + self.shift_px)
        return np.clip(pixels, 0, self.high - 1).astype(np.int32)


@dataclass(frozen=True, slots=True)
class Grid:
    """The four numbers between a low-resolution map and a still: still pixels a site, and the shift of the whole map."""

    scale_x: float
    scale_y: float
    shift_x_px: float = 0.0
    shift_y_px: float = 0.0

    def __post_init__(self) -> None:
        for name, scale in (("scale_x", self.scale_x), ("scale_y", self.scale_y)):
            if not 1.0 <= scale <= _LARGEST_SCALE:
                raise UsageError(f"{name} is {scale:g}: a still has 1 to {_LARGEST_SCALE:g} pixels for each of the map")
        for name, shift_px in (("shift_x_px", self.shift_x_px), ("shift_y_px", self.shift_y_px)):
            if not math.isfinite(shift_px):
                raise UsageError(f"{name} is {shift_px}: give a number of still pixels")

    @classmethod
    def between(cls, low: tuple[int, ...], high: tuple[int, ...]) -> Grid:
        """Return the grid of two pictures (height, width) that show the same: the scales are those of the sizes.

        >>> Grid.between((720, 640), (1440, 1280))
        Grid(scale_x=2.0, scale_y=2.0, shift_x_px=0.0, shift_y_px=0.0)
        """
        return cls(high[1] / low[1], high[0] / low[0])

    @classmethod
    def centred(cls, low: tuple[int, ...], high: tuple[int, ...], scale: float) -> Grid:
        """Return the grid of two pictures (height, width) with the same middle: a still that shows more, or less, than the map.

        >>> Grid.centred((720, 640), (3168, 2376), 3.7125)
        Grid(scale_x=3.7125, scale_y=3.7125, shift_x_px=0.0, shift_y_px=247.5)
        """
        return cls(scale, scale, (high[1] - scale * low[1]) / 2, (high[0] - scale * low[0]) / 2)

    def columns(self, low: int, high: int) -> Axis:
        """Work the x axis out for so many columns of the map and of the still."""
        return _axis(low, high, self.scale_x, self.shift_x_px)

    def rows(self, low: int, high: int) -> Axis:
        """Work the y axis out for so many rows of the map and of the still."""
        return _axis(low, high, self.scale_y, self.shift_y_px)


def _axis(low: int, high: int, scale: float, shift_px: float) -> Axis:
    places = (np.arange(high) - shift_px + 0.5) / scale - 0.5
    covered = np.flatnonzero((places >= -0.5 - _SLACK) & (places <= low - 0.5 + _SLACK))
    first, end = (int(covered[0]), int(covered[-1]) + 1) if covered.size else (0, 0)
    given, low = low, max(low, 2)  # a single row or column stands for two alike
    cell = np.clip(np.floor(places), 0, low - 2).astype(np.int32)
    starts = np.searchsorted(cell, np.arange(low)).astype(np.int32)
    starts[-1] = high
    sites = np.floor((np.arange(low) + 0.5) * scale - 0.5 + shift_px + _SLACK)
    return Axis(
        given, low, high, first, end, cell, (places - cell).astype(np.float32), np.clip(starts, first, end).astype(np.int32),
        np.clip(sites, 0, high - 1).astype(np.int32), scale, shift_px,
    )  # fmt: skip
