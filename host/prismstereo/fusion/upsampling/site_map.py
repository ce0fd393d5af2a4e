"""A low-resolution map made ready: holes filled, slopes, cells across depth edges; and what is the same for all methods."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.flags import Flag
from prismstereo.fusion.upsampling.grid import Grid
from prismstereo.fusion.upsampling.render_kernels import interpolate_rows, mark_filled
from prismstereo.fusion.upsampling.site_kernels import RIM, fill_holes, find_edges, site_slopes

__all__ = ["THRESHOLD_PX", "SiteMap"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]

THRESHOLD_PX = 0.5  # of the low resolution: sites of a cell that differ by less are of one surface


class SiteMap:
    """The sites of maps of one size on stills of one size: buffers that are filled anew by each `read`.

    `sites`, `across` and `down` (h + 2 RIM, w + 2 RIM) float32 are disparity in still pixels and its slopes a site, rimmed;
    `holes` (h, w) uint8 is 1 where the map was empty; h and w are two at least.
    """

    def __init__(self, low: tuple[int, int], high: tuple[int, int], grid: Grid) -> None:
        self.columns, self.rows = grid.columns(low[1], high[1]), grid.rows(low[0], high[0])
        self.shape = self.rows.low, self.columns.low
        rimmed = self.shape[0] + 2 * RIM, self.shape[1] + 2 * RIM
        self.sites, self.across, self.down = (np.zeros(rimmed, np.float32) for _ in range(3))
        self.holes = np.zeros(self.shape, np.uint8)
        self.threshold_px = THRESHOLD_PX * grid.scale_x
        self.matched = 0
        self._scale = grid.scale_x
        self._edges = np.zeros(self.shape, np.int32)

    def read(self, disparity_px: Float) -> None:
        """Take a map in, (h, w) float32 low-resolution pixels, NaN for holes; they are filled with the farther side."""
        for axis, given in enumerate(disparity_px.shape):
            if given < self.shape[axis]:  # a single row or column
                disparity_px = np.repeat(disparity_px, self.shape[axis], axis)
        whole = np.ascontiguousarray(disparity_px, np.float32)
        self.matched = fill_holes(whole, np.float32(self._scale), self.sites, self.holes)
        site_slopes(self.sites, np.float32(self.threshold_px), 0, self.shape[0], self.across, self.down)

    def edges(self, first: int, end: int) -> NDArray[np.int32]:
        """Return the cells of cell rows `first` .. `end` - 1 that lie across a depth edge: upper left sites, with the rim."""
        room = self._edges[first:end].reshape(-1)
        threshold = np.float32(self.threshold_px)
        return room[: find_edges(self.sites, self.across, self.down, threshold, first, end, room)]

    def still_rows(self, first: int, end: int) -> tuple[int, int]:
        """Return the still rows (first, end) of cell rows `first` .. `end` - 1; the outermost take what is beyond them."""
        starts = self.rows.starts
        return (int(starts[first]) if first else 0), (int(starts[end]) if end < self.rows.low - 1 else self.rows.high)

    def flag_band(self, flags: Byte) -> None:
        """Flag the pixels of all cells across a depth edge as band, and as nothing else."""
        columns, rows, stride = self.columns.starts, self.rows.starts, self.sites.shape[1]
        for cell in self.edges(0, self.rows.low - 1).tolist():
            j, i = cell // stride - RIM, cell % stride - RIM
            flags[rows[j] : rows[j + 1], columns[i] : columns[i + 1]] = Flag.BAND

    def given_sources(self, source: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return sources counted in the map that was given, which may have had a single row or column; -1 stays."""
        given = self.rows.sites_given, self.columns.sites_given
        if given == self.shape:
            return source
        row, column = source // self.shape[1], source % self.shape[1]
        counted = np.minimum(row, given[0] - 1) * given[1] + np.minimum(column, given[1] - 1)
        return np.where(source < 0, source, counted).astype(np.int32)

    def values(self) -> Float:
        """Return the disparity of the sites in still pixels, holes filled: a copy (h, w)."""
        return self.sites[RIM:-RIM, RIM:-RIM].copy()

    def interpolate(self, first: int, end: int, out: Float, flags: Byte) -> None:
        """Write still rows `first` .. `end` - 1 as if everything were one surface: all of it is flagged flat, or unseen."""
        columns, rows = self.columns, self.rows
        seen, rows_seen = (columns.first, columns.end), (rows.first, rows.end)
        interpolate_rows(
            self.sites, columns.cell, columns.part, rows.cell, rows.part, seen, rows_seen, first, end, out, flags
        )
        if self.matched < self.holes.size:
            first, end = max(first, rows.first), min(end, rows.end)
            mark_filled(self.holes, columns.cell, columns.part, rows.cell, rows.part, seen, first, end, flags)
