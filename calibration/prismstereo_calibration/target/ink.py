"""What is black on a sheet: rectangles that do not overlap, and the same in pixels.

Rectangles are x0, y0, x1, y1 with x to the right and y down, in whatever unit and frame the maker of the ink says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Ink", "Raster"]

Array = NDArray[np.float64]
Frame = tuple[float, float, float, float]
_SAME = 9  # decimals: edges that were reckoned along different ways and agree so far are one edge


@dataclass(frozen=True, slots=True)
class Raster:
    """A picture, (height, width) uint8 with 255 for paper, and the matrix (3, 3) from the plane of the ink to its pixels.

    Pixel (0, 0) is the centre of the top-left pixel; a pixel's grey is the share of paper in it.
    """

    pixels: NDArray[np.uint8]
    pixel_from_plane: Array

    def pixel(self, points: Array) -> Array:
        """Return the pixels (..., 2) of points (..., 2 or 3) of the plane."""
        return np.asarray(points[..., :2] @ self.pixel_from_plane[:2, :2].T + self.pixel_from_plane[:2, 2])


@dataclass(frozen=True, slots=True)
class Ink:
    """Rectangles (N, 4) float64 that are black; no two overlap, so that their areas add up."""

    rectangles: Array

    @classmethod
    def of(cls, rectangles: Array) -> Ink:
        """Make ink of rectangles (N, 4) that may overlap: cut along their edges and joined again to few large ones."""
        xs, ys, black = _tiles(np.reshape(rectangles, (-1, 4)))
        return cls(_joined(xs, ys, black))

    @property
    def bounds(self) -> Frame:
        """The smallest rectangle around all ink."""
        low, high = self.rectangles[:, :2].min(axis=0), self.rectangles[:, 2:].max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def moved(self, x: float, y: float, scale: float = 1.0) -> Ink:
        """Return this ink scaled about its origin, which then stands at (x, y)."""
        return Ink(self.rectangles * scale + np.array([x, y, x, y]))

    def beside(self, other: Ink) -> Ink:
        """Return this ink and another that stands clear of it."""
        return Ink(np.concatenate([self.rectangles, other.rectangles]))

    def negative(self, frame: Frame) -> Ink:
        """Return the ink of everything within the frame (which holds all of this ink) that is paper now."""
        around = np.concatenate([self.rectangles, np.reshape(frame, (1, 4))])
        xs, ys, black = _tiles(around, around[:-1])
        return Ink(_joined(xs, ys, ~black))

    def raster(self, frame: Frame, pixels_per_unit: float) -> Raster:
        """Draw what lies within a frame; each pixel has the grey of the ink's exact share in it."""
        x0, y0, x1, y1 = frame
        shape = math.ceil((y1 - y0) * pixels_per_unit - 1e-6), math.ceil((x1 - x0) * pixels_per_unit - 1e-6)
        black = np.zeros(shape)
        for left, top, right, bottom in (self.rectangles - [x0, y0, x0, y0]) * pixels_per_unit:
            columns, across = _shares(left, right, shape[1])
            rows, down = _shares(top, bottom, shape[0])
            black[rows, columns] += np.outer(down, across)
        scale = pixels_per_unit
        placed = np.array([[scale, 0, -x0 * scale - 0.5], [0, scale, -y0 * scale - 0.5], [0, 0, 1.0]])
        return Raster(np.rint(255 * (1 - np.clip(black, 0, 1))).astype(np.uint8), placed)


def _shares(begin: float, end: float, count: int) -> tuple[slice, Array]:
    """Return which of so many unit cells an interval touches, and how much of each it covers."""
    first, last = max(math.floor(begin), 0), max(min(math.ceil(end), count), 0)
    cell = np.arange(first, last)
    return slice(first, last), np.clip(np.minimum(cell + 1, end) - np.maximum(cell, begin), 0, 1)


def _tiles(edges_of: Array, black_of: Array | None = None) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Cut the plane along all edges: x and y of the cuts, and which tiles (rows, columns) are black."""
    edges_of = np.round(edges_of, _SAME)
    black_of = edges_of if black_of is None else np.round(black_of, _SAME)
    xs, ys = np.unique(edges_of[:, [0, 2]]), np.unique(edges_of[:, [1, 3]])
    black = np.zeros((len(ys) - 1, len(xs) - 1), bool)
    columns, rows = np.searchsorted(xs, black_of[:, [0, 2]]), np.searchsorted(ys, black_of[:, [1, 3]])
    for (left, right), (top, bottom) in zip(columns, rows, strict=True):
        black[top:bottom, left:right] = True
    return xs, ys, black


def _joined(xs: Array, ys: Array, black: NDArray[np.bool_]) -> Array:
    """Join black tiles to rectangles: runs along a row, and equal runs of rows that follow each other."""
    found: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}  # run of columns -> the row in which it began
    padded = np.pad(black, ((0, 1), (1, 1))).astype(np.int8)
    for row, steps in enumerate(np.diff(padded, axis=1)):
        runs = set(zip(np.flatnonzero(steps == 1).tolist(), np.flatnonzero(steps == -1).tolist(), strict=True))
        found += [(left, growing.pop((left, right)), right, row) for left, right in sorted(set(growing) - runs)]
        for run in runs - set(growing):
            growing[run] = row
    x0, y0, x1, y1 = np.array(sorted(found, key=lambda one: (one[1], one[0])), int).reshape(-1, 4).T
    return np.stack([xs[x0], ys[y0], xs[x1], ys[y1]], axis=-1)
