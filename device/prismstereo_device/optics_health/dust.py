"""Dust: places of one view that stay darker than the other view shows the same things.

Dust stands still in its own view while the scene moves, so that the ratio of both views' brightness at matched pixels is
gathered by cell, once in the left view's cells and once in the right view's. In its own view a speck darkens the same cell
whatever the depth; that it looks like a bright speck from the other view is not counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.rectify import RectifiedPair

__all__ = ["DustMap", "DustSpot"]

_CELL = 16  # pixels a side
_STEP = 2  # every second pixel, both ways
_LEAST_PIXELS = 12  # of a cell in one look
_LEAST_LOOKS = 4
_MOST_LOG_RATIO = 0.7
_DARKER = 0.06  # natural logarithm: 6 % of the light
_SURE = 4.0  # standard errors
_AROUND = 9  # cells a side that a cell is compared with
_DARK_GREY = 8.0
_EDGE = 9  # pixels a side
_FLAT_PX = 2.0

Cells = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DustSpot:
    """A dark spot of a view: its middle as shares of the view's width and height, and the share of light that it takes."""

    x_share: float
    y_share: float
    dark: float


class _Side:
    """What was gathered for one view: sums over looks of a cell's log ratio, of its square, and the number of looks."""

    def __init__(self, cells: tuple[int, int]) -> None:
        self.total, self.squares, self.looks = (np.zeros(cells) for _ in range(3))

    def add(self, rows: NDArray[np.intp], columns: NDArray[np.intp], ratio: NDArray[np.float32]) -> None:
        shape = self.total.shape
        place = np.ravel_multi_index((rows // _CELL, columns // _CELL), shape)
        count = np.bincount(place, minlength=self.total.size).reshape(shape)
        mean = np.bincount(place, ratio, self.total.size).reshape(shape) / np.maximum(count, 1)
        seen = count >= _LEAST_PIXELS
        self.total += np.where(seen, mean, 0)
        self.squares += np.where(seen, mean * mean, 0)
        self.looks += seen

    def spots(self) -> tuple[DustSpot, ...]:
        """Return the spots that are sure by now."""
        looks = np.maximum(self.looks, 1)
        mean = np.where(self.looks >= _LEAST_LOOKS, self.total / looks, np.nan)
        spread = np.sqrt(np.maximum(self.squares / looks - (self.total / looks) ** 2, 0) / looks)
        drop = _surroundings(mean) - mean
        with np.errstate(invalid="ignore"):
            dark = (drop > _DARKER) & (drop > _SURE * spread)
        number, labels = cv2.connectedComponents(dark.astype(np.uint8), connectivity=8)
        return tuple(self._spot(labels == label, drop) for label in range(1, number))

    def _spot(self, where: NDArray[np.bool_], drop: Cells) -> DustSpot:
        rows, columns = np.nonzero(where)
        weights = drop[where]
        height, width = drop.shape
        x, y = float(np.average(columns, weights=weights)), float(np.average(rows, weights=weights))
        return DustSpot((x + 0.5) / width, (y + 0.5) / height, 1 - float(np.exp(-weights.max())))


class DustMap:
    """Gathers looks at pairs (height, width) of one rectification."""

    def __init__(self, width: int, height: int) -> None:
        cells = -(-height // _CELL), -(-width // _CELL)
        self._left, self._right = _Side(cells), _Side(cells)

    def add(self, pair: RectifiedPair, disparity: DisparityMap) -> None:
        """Gather what one matched pair tells; the map has the pair's size."""
        found = _on_surfaces(disparity.disparity_px)[::_STEP, ::_STEP]
        rows, columns = np.nonzero(np.isfinite(found))
        partner = columns * _STEP - found[rows, columns]
        rows, columns = rows * _STEP, columns * _STEP
        other = np.rint(partner).astype(np.intp)
        inside = (other >= 0) & (other < pair.right.shape[1])
        rows, columns, other = rows[inside], columns[inside], other[inside]
        left = cv2.GaussianBlur(pair.left, (0, 0), 1.5)[rows, columns].astype(np.float32)
        right = cv2.GaussianBlur(pair.right, (0, 0), 1.5)[rows, other].astype(np.float32)
        lit = np.minimum(left, right) > _DARK_GREY
        rows, columns, other = rows[lit], columns[lit], other[lit]
        if rows.size == 0:
            return
        ratio = np.log(left[lit] / right[lit])
        ratio = np.clip(ratio - np.median(ratio), -_MOST_LOG_RATIO, _MOST_LOG_RATIO)
        self._left.add(rows, columns, ratio)
        self._right.add(rows, other, -ratio)

    def spots(self) -> tuple[tuple[DustSpot, ...], tuple[DustSpot, ...]]:
        """Return the spots of the left view and of the right one."""
        return self._left.spots(), self._right.spots()


def _on_surfaces(found: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the matches that stand amid matches of about their own depth: at an edge each view sees something else."""
    around = np.ones((_EDGE, _EDGE), np.uint8)
    least = cv2.erode(np.nan_to_num(found, nan=-1e4), around)
    most = cv2.dilate(np.nan_to_num(found, nan=1e4), around)
    return np.where(most - least < _FLAT_PX, found, np.float32(np.nan))


def _surroundings(mean: Cells) -> Cells:
    """Return the median of the cells around each, those that were not seen left out."""
    padded = np.pad(mean, _AROUND // 2, constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, (_AROUND, _AROUND)).reshape(*mean.shape, -1)
    known: NDArray[np.bool_] = np.any(np.isfinite(around), axis=-1)
    filled = np.where(known[..., None], around, 0.0)
    return np.where(known, np.nanmedian(filled, axis=-1), np.nan)
