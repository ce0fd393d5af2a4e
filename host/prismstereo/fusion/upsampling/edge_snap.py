"""Edge snapping: every cell across a depth edge is a small problem of its own, near or far, decided by colour votes.

Cells of one surface, most of a picture, are interpolated. Each of the others is split into a near and a far side; the sites
around it vote by likeness of colour which side each place in it belongs to, a small net draws the border from the votes, and
the pixels of either side take its plane. Then a pixel that most of its neighbours disagree with takes their median. Cells know
nothing of each other, so the same bits come out of any number of threads.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling.bands import bands_of
from prismstereo.fusion.upsampling.grid import Axis, Grid
from prismstereo.fusion.upsampling.majority_kernels import LEAST_SIDE, find_medians, find_outvoted, replace_outvoted
from prismstereo.fusion.upsampling.side_net import COARSE, FINE, SideNet, read_nets
from prismstereo.fusion.upsampling.site_kernels import RIM, site_colours
from prismstereo.fusion.upsampling.site_map import SiteMap
from prismstereo.fusion.upsampling.snap_kernels import snap_cells, vote_all
from prismstereo.fusion.upsampling.upsampled import Upsampled
from prismstereo_hw.errors import UsageError

__all__ = ["EdgeSnap", "SeenCells"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

_FINE_FROM = math.sqrt(COARSE * FINE)  # still pixels a site
_REACH = 2.7  # sites from the middle of a cell whose sites vote
_NEARNESS = 0.5  # how fast a vote fades with the square of the distance in sites
_RANGES = (12.0, 50.0)  # summed difference of three colours at which a vote has faded
_SETTLED_FROM = 3.0  # still pixels a site; at less, 5x5 pixels are more than two sites and would take small things away
_BAND_CELLS = 16  # rows of cells that are worked on at a time


@dataclass(frozen=True, slots=True)
class _Voters:
    """Which sites vote in a cell and how much by their distance: offsets (N,), weights (side * side, N)."""

    offsets: Int
    weights: Float

    @classmethod
    def around(cls, side: int, stride: int) -> _Voters:
        steps = np.arange(-2, 4)
        down, across = (step.ravel() for step in np.meshgrid(steps, steps, indexing="ij"))
        within = (down - 0.5) ** 2 + (across - 0.5) ** 2 < _REACH**2
        down, across = down[within], across[within]
        assert down.size % 4 == 0
        place = (np.arange(side) + 0.5) / side
        y, x = (place.ravel() for place in np.meshgrid(place, place, indexing="ij"))
        weights = np.exp(-_NEARNESS * ((y[:, None] - down) ** 2 + (x[:, None] - across) ** 2))
        return cls((down * stride + across).astype(np.int32), weights.astype(np.float32))


@dataclass(frozen=True, slots=True)
class _Places:
    """Where a cell's places lie along an axis: their pixels (cells * side,), and between which of them each pixel lies."""

    pixels: Int
    spots: Int
    shares: Float

    @classmethod
    def along(cls, axis: Axis, side: int) -> _Places:
        middles = (np.arange(side) + 0.5) / side
        pixels = axis.pixels_at((np.arange(axis.low - 1)[:, None] + middles).ravel())
        between = np.clip(axis.part.astype(np.float64) * side - 0.5, 0, side - 1)
        spots = np.minimum(between.astype(np.int32), side - 2)
        return cls(pixels, spots, (between - spots).astype(np.float32))


@dataclass(frozen=True, slots=True)
class SeenCells:
    """Cells (N): `inputs` (N, F) of the net, disparity of either side in still pixels, pixels (N, side) of their places."""

    inputs: Float
    far_px: Float
    near_px: Float
    pixel_rows: Int
    pixel_columns: Int


class EdgeSnap:
    """An upsampler for maps and stills of one size and grid; keeps its buffers, so one thread uses it at a time.

    `learned` off leaves out the net and lets the votes alone decide; `settled` off leaves lone pixels as they are.
    """

    def __init__(
        self, low: tuple[int, int], high: tuple[int, int], planes: int, grid: Grid, *,
        threads: int = 2, learned: bool = True, settled: bool = True,
    ) -> None:  # fmt: skip
        if threads < 1:
            raise UsageError(f"{threads} threads cannot work: give 1 or more")
        self._map = SiteMap(low, high, grid)
        side = COARSE if math.sqrt(grid.scale_x * grid.scale_y) < _FINE_FROM else FINE
        self._net = read_nets()[side] if learned else SideNet.none(side)
        self._settled = settled and min(grid.scale_x, grid.scale_y) >= _SETTLED_FROM
        self._threads, self._high = threads, high
        rimmed = self._map.sites.shape
        self._colours = np.zeros((planes, *rimmed), np.float32)
        self._columns, self._rows = _Places.along(self._map.columns, side), _Places.along(self._map.rows, side)
        columns, rows = (np.diff(axis.starts).max() for axis in (self._map.columns, self._map.rows))
        self._most_pixels = int(columns * rows)
        self._voters = _Voters.around(side, rimmed[1])
        spread = 3.0 / planes  # a grey level stands for three colours that differ alike
        self._ranges = tuple(np.float32(spread**2 / (3 * reach**2)) for reach in _RANGES)

    def upsample(self, disparity_px: Float, guide: Byte, into: Upsampled | None = None) -> Upsampled:
        """Upsample a map (h, w) float32, NaN for holes, with a guide (H, W, planes) uint8.

        With `into`, the result's arrays are those of that earlier result, which is lost.
        """
        out = np.empty(self._high, np.float32) if into is None else into.disparity_px
        flags = np.empty(self._high, np.uint8) if into is None else into.flags
        done = Upsampled(out, flags, self._map.columns, self._map.rows)
        self._map.read(disparity_px)
        cells = self._map.rows.low - 1
        bands = bands_of(cells, _BAND_CELLS)
        with ThreadPoolExecutor(self._threads) as pool:
            list(pool.map(lambda band: self._look(guide, *band), bands))
            snapped = list(pool.map(lambda band: self._snap(guide, band, done), bands))
            if self._settled:
                found = list(pool.map(lambda cells: self._outvoted(done, cells), snapped))
                list(pool.map(lambda chosen: self._replace(done, *chosen), found))
        if not self._map.matched:
            out[:] = np.nan
        return done

    def look_into(self, disparity_px: Float, guide: Byte) -> SeenCells:
        """Return what is known of all cells across depth edges before a net decides: what nets are trained on."""
        held, side = self._map, self._net.side
        held.read(disparity_px)
        self._look(guide, 0, held.rows.low - 1)
        cells, stride = held.edges(0, held.rows.low - 1), held.sites.shape[1]
        rows, columns = (self._rows.pixels.reshape(-1, side), self._columns.pixels.reshape(-1, side))
        inputs, gaps = vote_all(
            guide, held.sites, self._colours, cells, self._voters.offsets, self._voters.weights, self._ranges,
            self._columns.pixels, self._rows.pixels, side,
        )  # fmt: skip
        return SeenCells(inputs, gaps[:, 0], gaps[:, 1], rows[cells // stride - RIM], columns[cells % stride - RIM])

    def _look(self, guide: Byte, first: int, end: int) -> None:
        columns, rows = self._map.columns, self._map.rows
        site_colours(guide, columns.sites, rows.sites, first, end + (end == rows.low - 1), self._colours)

    def _snap(self, guide: Byte, band: tuple[int, int], done: Upsampled) -> Int:
        held, columns, rows, voters = self._map, self._map.columns, self._map.rows, self._voters
        held.interpolate(*held.still_rows(*band), done.disparity_px, done.flags)
        cells = held.edges(*band)
        snap_cells(
            guide, held.sites, held.across, held.down, held.holes, self._colours, cells,
            voters.offsets, voters.weights, self._ranges, self._columns.pixels, self._rows.pixels, self._net.side,
            self._net.numbers, self._net.layers, columns.starts, self._columns.spots, self._columns.shares, columns.part,
            rows.starts, self._rows.spots, self._rows.shares, rows.part, done.disparity_px, done.flags,
        )  # fmt: skip
        return cells

    def _outvoted(self, done: Upsampled, cells: Int) -> tuple[Int, Float]:
        """Find the pixels of cells that the majority around them disagrees with, and what they are to be."""
        held, columns, rows = self._map, self._map.columns, self._map.rows
        seen = rows.first, rows.end, columns.first, columns.end
        if cells.size == 0 or min(seen[1] - seen[0], seen[3] - seen[2]) < LEAST_SIDE:
            return np.zeros(0, np.int32), np.zeros(0, np.float32)
        reach, out, stride = np.float32(held.threshold_px), done.disparity_px, held.sites.shape[1]
        room = np.empty(cells.size * self._most_pixels, np.int32)
        found = room[: find_outvoted(out, cells, stride, columns.starts, rows.starts, reach, seen, room)].copy()
        medians = np.empty(found.size, np.float32)
        find_medians(out, found, medians)
        return found, medians

    def _replace(self, done: Upsampled, found: Int, medians: Float) -> None:
        held = self._map
        replace_outvoted(
            held.sites, held.holes, held.columns.cell, held.rows.cell, found, medians, done.disparity_px, done.flags
        )
