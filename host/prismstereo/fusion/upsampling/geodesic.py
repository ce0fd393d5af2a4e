"""The geodesic method, the reference of `edge_snap`: a pixel at a depth edge takes the surface of the site nearest by way.

Ways run over the guide and are dear where it changes, but no step costs more than a cap: without it, texture within a surface
would move the border.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.flags import Flag
from prismstereo.fusion.upsampling.bands import bands_of, in_bands
from prismstereo.fusion.upsampling.geodesic_kernels import plant, sweep, take_values
from prismstereo.fusion.upsampling.grid import Grid
from prismstereo.fusion.upsampling.site_map import SiteMap
from prismstereo.fusion.upsampling.upsampled import Upsampled

__all__ = ["geodesic"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

_PER_LEVEL = 0.3  # cost of a grey level of change
_CAP = 4.0
_WEAK_COST = 4.0  # of a start beside a depth edge: matchers fatten there
_STRIPS = 16
_MEDIAN = 5


def geodesic(disparity_px: Float, guide: Byte, grid: Grid, threads: int = 2) -> Upsampled:
    """Upsample a map (h, w) float32, NaN for holes, with a grey guide (H, W) uint8."""
    held = SiteMap(disparity_px.shape, guide.shape, grid)
    held.read(disparity_px)
    out, flags = np.empty(guide.shape, np.float32), np.empty(guide.shape, np.uint8)
    bands = bands_of(guide.shape[0], -(-guide.shape[0] // _STRIPS))
    held.interpolate(0, guide.shape[0], out, flags)
    held.flag_band(flags)
    cost, source = np.empty(guide.shape, np.float32), np.empty(guide.shape, np.int32)
    columns, rows, threshold = held.columns, held.rows, np.float32(held.threshold_px)

    def start(first: int, end: int) -> None:
        plant(
            held.sites, held.holes, threshold, np.float32(_WEAK_COST), columns.cell, columns.part, columns.scale,
            rows.cell, rows.part, rows.scale, flags, first, end, cost, source,
        )  # fmt: skip

    def finish(first: int, end: int) -> None:
        take_values(
            held.sites, held.across, held.down, held.holes, source, columns.cell, columns.part, rows.cell, rows.part,
            first, end, out, flags,
        )  # fmt: skip

    in_bands(start, bands, threads)
    for downward in (True, False):
        _sweep_all(guide, flags, bands, downward, cost, source, threads)
    in_bands(finish, bands, threads)
    _smooth(out, source, flags, (rows.first, rows.end, columns.first, columns.end))
    if not held.matched:
        out[:] = np.nan
        source[:] = -1
    return Upsampled(out, flags, columns, rows, held.given_sources(source))


def _sweep_all(
    guide: Byte, flags: Byte, bands: list[tuple[int, int]], downward: bool, cost: Float, source: Int, threads: int
) -> None:
    """Sweep all strips at once; each sees the row before its first one as it was before."""
    steps = np.minimum(_PER_LEVEL * np.arange(256, dtype=np.float32), np.float32(_CAP)).astype(np.float32)
    height = guide.shape[0]
    before = {}
    for first, end in bands:
        row = min(max(first - 1 if downward else end, 0), height - 1)
        before[first] = cost[row].copy(), source[row].copy()
    in_bands(
        lambda first, end: sweep(guide, steps, flags, first, end, downward, *before[first], cost, source),
        bands,
        threads,
    )


def _smooth(out: Float, source: Int, flags: Byte, seen: tuple[int, int, int, int]) -> None:
    """Put the median of 5x5 in the place of the band's pixels, with its source."""
    top, bottom, left, right = seen
    if top == bottom or left == right:
        return
    inside = np.ascontiguousarray(out[top:bottom, left:right])
    whence = source[top:bottom, left:right].copy()
    smooth = cv2.medianBlur(inside, _MEDIAN)
    rows, columns = np.nonzero(((flags[top:bottom, left:right] & Flag.BAND) != 0) & (smooth != inside))
    wanted, found = smooth[rows, columns], whence[rows, columns]
    for step in range(_MEDIAN * _MEDIAN):
        there = (
            np.clip(rows + step // _MEDIAN - _MEDIAN // 2, 0, bottom - top - 1),
            np.clip(columns + step % _MEDIAN - _MEDIAN // 2, 0, right - left - 1),
        )
        found = np.where(inside[there] == wanted, whence[there], found)
    out[rows + top, columns + left], source[rows + top, columns + left] = wanted, found
