"""Two methods that weigh the sites around a pixel by distance and by likeness of grey level.

`joint_bilateral` is the paper's: the weighted mean D(i) = sum G_s(|i - j|) G_r(|I_i - I_j|) c_j D_j / sum of the weights over
low-resolution sites j with confidence c_j. It averages two depths at an edge. `weighted_mode` takes there the disparity that
most of the weight agrees on, and interpolates elsewhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.flags import Flag
from prismstereo.fusion.upsampling.bands import bands_of, in_bands
from prismstereo.fusion.upsampling.grid import Grid
from prismstereo.fusion.upsampling.site_map import SiteMap
from prismstereo.fusion.upsampling.upsampled import Upsampled
from prismstereo.fusion.upsampling.weighing_kernels import STEPS_A_SQUARE, weighted_means, weighted_modes

__all__ = ["joint_bilateral", "weighted_mode"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]

_RADIUS = 2  # sites
_SPATIAL = 1.0  # sites
_RANGE = 12.0  # grey levels
_BAND_ROWS = 64


def joint_bilateral(
    disparity_px: Float, guide: Byte, grid: Grid, confidence: Float | None = None, threads: int = 2
) -> Upsampled:
    """Upsample a map (h, w) float32, NaN for holes, with a grey guide (H, W) uint8 and confidences (h, w), 0 or more."""
    held, trust = _trusted(disparity_px, guide, grid, confidence)
    out, flags = np.empty(guide.shape, np.float32), np.full(guide.shape, Flag.FLAT, np.uint8)
    source = np.empty(guide.shape, np.int32)
    columns, rows = held.columns, held.rows
    flags[: rows.first] = flags[rows.end :] = Flag.NO_LOW_RESOLUTION
    flags[:, : columns.first] = flags[:, columns.end :] = Flag.NO_LOW_RESOLUTION
    held.flag_band(flags)
    tables, sites = _tables(), _point_greys(guide, held)
    values = held.values()

    def work(first: int, end: int) -> None:
        weighted_means(
            values, trust, sites, guide, columns.cell, columns.part, rows.cell, rows.part, _RADIUS, *tables, first, end,
            out, source, flags,
        )  # fmt: skip

    in_bands(work, bands_of(guide.shape[0], _BAND_ROWS), threads)
    return Upsampled(out, flags, columns, rows, held.given_sources(source))


def weighted_mode(
    disparity_px: Float, guide: Byte, grid: Grid, confidence: Float | None = None, threads: int = 2
) -> Upsampled:
    """Upsample a map (h, w) float32, NaN for holes, with a grey guide (H, W) uint8 and confidences (h, w), 0 or more."""
    held, trust = _trusted(disparity_px, guide, grid, confidence)
    out, flags = np.empty(guide.shape, np.float32), np.empty(guide.shape, np.uint8)
    columns, rows = held.columns, held.rows
    held.interpolate(0, guide.shape[0], out, flags)
    nearest = Upsampled(out, flags, columns, rows).source
    held.flag_band(flags)
    source = np.empty(guide.shape, np.int32)
    tables, sites, reach = _tables(), _point_greys(guide, held), np.float32(2 * held.threshold_px)
    values = held.values()

    def work(first: int, end: int) -> None:
        weighted_modes(
            values, trust, sites, guide, columns.cell, columns.part, rows.cell, rows.part, _RADIUS, *tables, reach, first,
            end, out, source, flags,
        )  # fmt: skip

    in_bands(work, bands_of(guide.shape[0], _BAND_ROWS), threads)
    source = np.where((flags & Flag.BAND) != 0, held.given_sources(source), nearest)
    if not held.matched:
        out[:] = np.nan
        source[:] = -1
    return Upsampled(out, flags, columns, rows, source)


def _trusted(disparity_px: Float, guide: Byte, grid: Grid, confidence: Float | None) -> tuple[SiteMap, Float]:
    """Return the sites, and how much each counts: nothing where there was no match."""
    held = SiteMap(disparity_px.shape, guide.shape, grid)
    held.read(disparity_px)
    matched = held.holes == 0
    if confidence is None:
        return held, matched.astype(np.float32)
    given = np.broadcast_to(confidence, held.shape)
    return held, np.where(matched & (given > 0), given, 0).astype(np.float32)


def _point_greys(guide: Byte, held: SiteMap) -> Byte:
    """Return the guide at the still pixel nearest to each site, (h, w) uint8."""
    rows, columns = (axis.pixels_at(np.arange(axis.low, dtype=np.float64)) for axis in (held.rows, held.columns))
    return guide[rows[:, None], columns]


def _tables() -> tuple[Float, Float]:
    """Return the weights by squared distance, in 1/32 of a square site, and by difference in grey level, 0 to 255."""
    squares = np.arange(2 * STEPS_A_SQUARE * (_RADIUS + 1) ** 2 + 2, dtype=np.float64) / STEPS_A_SQUARE
    levels = np.arange(256, dtype=np.float64)
    nearness = np.exp(-squares / (2 * _SPATIAL**2)).astype(np.float32)
    return nearness, np.exp(-(levels**2) / (2 * _RANGE**2)).astype(np.float32)
