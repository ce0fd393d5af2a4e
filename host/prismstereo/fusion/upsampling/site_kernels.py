"""Compiled loops over low-resolution sites: holes filled, slopes, and which cells lie across a depth edge.

Maps with a *rim* have `RIM` more sites on every side, copies of the outermost, so that no neighbourhood needs a bound.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled

__all__ = ["RIM", "fill_holes", "find_edges", "site_colours", "site_slopes"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

RIM = 3
_ZERO = np.float32(0)
_HALF = np.float32(0.5)
_QUARTER = np.float32(0.25)
_STEEPEST = np.float32(2.0)  # of a surface, in thresholds a site; what is steeper is a depth edge


@compiled
def fill_holes(disparity: Float, scale: np.float32, sites: Float, holes: Byte) -> int:
    """Write disparity (h, w) times `scale` into `sites` (h + 2 RIM, w + 2 RIM), holes as the farther side of their row.

    A row of holes alone takes what is farther of the nearest rows. `holes` (h, w) becomes 1 where nothing was matched. Returns
    how many sites were matched; with none, sites are 0.
    """
    h, w = disparity.shape
    matched = 0
    before = np.full(h, -1, np.int64)  # the nearest row above with a match
    last = -1
    for j in range(h):
        found = _fill_row(disparity[j], scale, sites[j + RIM], holes[j])
        matched += found
        if found:
            last = j
        before[j] = last
    after = -1
    for j in range(h - 1, -1, -1):
        if before[j] == j:
            after = j
            continue
        row = sites[j + RIM]
        for i in range(RIM, w + RIM):
            above = sites[before[j] + RIM, i] if before[j] >= 0 else np.float32(np.inf)
            below = sites[after + RIM, i] if after >= 0 else np.float32(np.inf)
            farther = min(above, below)
            row[i] = farther if farther < np.float32(np.inf) else _ZERO
    _rim(sites, h, w)
    return matched


@compiled
def _fill_row(disparity: Float, scale: np.float32, row: Float, holes: Byte) -> int:
    w = disparity.size
    matched = 0
    previous = -1
    for i in range(w):
        value = disparity[i]
        hole = not np.isfinite(value)
        holes[i] = hole
        if hole:
            continue
        scaled = value * scale
        row[i + RIM] = scaled
        if previous < i - 1:
            filling = scaled if previous < 0 else min(scaled, row[previous + RIM])
            for k in range(previous + 1, i):
                row[k + RIM] = filling
        previous = i
        matched += 1
    if previous >= 0:
        for k in range(previous + 1, w):
            row[k + RIM] = row[previous + RIM]
    return matched


@compiled
def _rim(sites: Float, h: int, w: int) -> None:
    for j in range(RIM, h + RIM):
        for k in range(RIM):
            sites[j, k] = sites[j, RIM]
            sites[j, w + RIM + k] = sites[j, w + RIM - 1]
    for k in range(RIM):
        sites[k] = sites[RIM]
        sites[h + RIM + k] = sites[h + RIM - 1]


@compiled
def site_slopes(sites: Float, threshold: np.float32, first: int, end: int, across: Float, down: Float) -> None:
    """Write the slopes of rows `first` .. `end` - 1 of the surface each site lies on; all arrays have a rim.

    A neighbour is on the same surface when it differs by less than half the threshold, or when it goes on as the neighbour
    opposite did. Where neither is, the surface counts as facing.
    """
    height, stride = sites.shape
    flat, out_across, out_down = sites.reshape(-1), across.reshape(-1), down.reshape(-1)
    for j in range(first + RIM, end + RIM):
        begin = j * stride
        for i in range(RIM, stride - RIM):
            at = np.uintp(begin + i)
            own = flat[at]
            left, right = own - flat[at - np.uintp(1)], flat[at + np.uintp(1)] - own
            above, below = own - flat[at - np.uintp(stride)], flat[at + np.uintp(stride)] - own
            # beyond the outermost sites a surface goes on as it comes
            left, right = (right if i == RIM else left), (left if i == stride - RIM - 1 else right)
            above, below = (below if j == RIM else above), (above if j == height - RIM - 1 else below)
            out_across[at] = _slope(left, right, threshold)
            out_down[at] = _slope(above, below, threshold)


@compiled
def _slope(before: np.float32, after: np.float32, threshold: np.float32) -> np.float32:
    near = threshold * _HALF
    even = (abs(before - after) < threshold * _QUARTER) & (abs(before + after) < threshold * np.float32(2) * _STEEPEST)
    one, two = (abs(before) < near) | even, (abs(after) < near) | even
    mean = (before + after) * _HALF
    single = before if one else (after if two else _ZERO)
    return mean if one & two else single


@compiled
def find_edges(
    sites: Float, across: Float, down: Float, threshold: np.float32, first: int, end: int, edges: Int
) -> int:
    """Write which cells of cell rows `first` .. `end` - 1 lie across a depth edge: their upper left site, counted with the rim.

    A cell is of one surface when its four sites differ by less than the threshold, or when along all four sides the slopes
    tell the step. Returns how many cells were written.
    """
    stride = sites.shape[1]
    flat, slopes_across, slopes_down = sites.reshape(-1), across.reshape(-1), down.reshape(-1)
    near = threshold * _HALF
    one, row = np.uintp(1), np.uintp(stride)
    count = 0
    for j in range(first + RIM, end + RIM):
        for i in range(RIM, stride - RIM - 1):
            at = np.uintp(j * stride + i)
            a, b, c, d = flat[at], flat[at + one], flat[at + row], flat[at + row + one]
            spread = max(a, b, c, d) - min(a, b, c, d)
            if spread < threshold:
                continue
            told = abs(b - a - (slopes_across[at] + slopes_across[at + one]) * _HALF) < near
            told &= abs(d - c - (slopes_across[at + row] + slopes_across[at + row + one]) * _HALF) < near
            told &= abs(c - a - (slopes_down[at] + slopes_down[at + row]) * _HALF) < near
            told &= abs(d - b - (slopes_down[at + one] + slopes_down[at + row + one]) * _HALF) < near
            if not told:
                edges[count] = np.int32(j * stride + i)
                count += 1
    return count


@compiled
def site_colours(guide: Byte, columns: Int, rows: Int, first: int, end: int, colours: Float) -> None:
    """Write the guide's mean over the 2x2 pixels at each site of rows `first` .. `end` - 1, with the rim of those rows.

    `guide` (H, W, C); `columns` (w,), `rows` (h,): the pixels at or before the sites; `colours` (C, h + 2 RIM, w + 2 RIM).
    """
    height, width, planes = guide.shape
    h, w = rows.size, columns.size
    for j in range(first, end):
        y0 = rows[j]
        y1 = min(y0 + 1, height - 1)
        for z in range(planes):
            out = colours[z, j + RIM]
            for i in range(w):
                x0 = columns[i]
                x1 = min(x0 + 1, width - 1)
                total = np.int32(guide[y0, x0, z]) + np.int32(guide[y0, x1, z])
                total += np.int32(guide[y1, x0, z]) + np.int32(guide[y1, x1, z])
                out[i + RIM] = np.float32(total) * _QUARTER
            for k in range(RIM):
                out[k] = out[RIM]
                out[w + RIM + k] = out[w + RIM - 1]
            for k in range(1, RIM + 1):
                if j == 0:
                    colours[z, RIM - k] = out
                if j == h - 1:
                    colours[z, h + RIM - 1 + k] = out
