"""Compiled loops of the geodesic method: seeds at the sites, shortest ways along the guide, values of the sources.

A pixel's way to a site costs 1 a step (a diagonal 1.414), and more where the guide changes, up to a cap. Ways are found by
sweeps over strips of rows; a strip sees its neighbours as they were before: threads change no bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling.site_kernels import RIM
from prismstereo_device.compiled import compiled

__all__ = ["plant", "sweep", "take_values"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

_FAR = np.float32(1e9)
_DIAGONAL = np.float32(1.41421356)
_HALF = np.float32(0.5)
_BAND = np.uint8(2)
_UNSEEN = np.uint8(8)


@compiled
def plant(
    sites: Float, holes: Byte, threshold: np.float32, weak_cost: np.float32, columns: Int, parts: Float, scale: float,
    rows: Int, row_parts: Float, row_scale: float, flags: Byte, first: int, end: int, cost: Float, source: Int,
) -> None:  # fmt: skip
    """Write cost and source of still rows `first` .. `end` - 1 before any way: 0 and the nearest site off the band.

    In the band only the pixel at a site starts, from `weak_cost` where the site is a hole or stands beside a depth edge.
    """
    w = holes.shape[1]
    for y in range(first, end):
        v = row_parts[y]
        j = rows[y] + (1 if v >= _HALF else 0)
        on_row = abs(float(v) - (j - rows[y])) * row_scale <= 0.5001
        for x in range(columns.size):
            u = parts[x]
            i = columns[x] + (1 if u >= _HALF else 0)
            cost[y, x], source[y, x] = np.float32(0), np.int32(j * w + i)
            if flags[y, x] & _UNSEEN:
                source[y, x] = -1
            elif flags[y, x] & _BAND:
                if on_row and abs(float(u) - (i - columns[x])) * scale <= 0.5001:
                    cost[y, x] = weak_cost if holes[j, i] or _stands_at_edge(sites, j, i, threshold) else np.float32(0)
                else:
                    cost[y, x], source[y, x] = _FAR, np.int32(-1)


@compiled
def _stands_at_edge(sites: Float, j: int, i: int, threshold: np.float32) -> bool:
    low, high = sites[j + RIM, i + RIM], sites[j + RIM, i + RIM]
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            value = sites[j + RIM + dy, i + RIM + dx]
            low, high = min(low, value), max(high, value)
    return bool(high - low >= threshold)


@compiled
def sweep(
    guide: Byte, steps: Float, flags: Byte, first: int, end: int, downward: bool,
    before_cost: Float, before_source: Int, cost: Float, source: Int,
) -> None:  # fmt: skip
    """Shorten the ways of the band in rows `first` .. `end` - 1, downward or upward, each row to and fro.

    `steps` (256,) is what a change of the guide costs; `before_cost`, `before_source` (W,) are the row before the first one.
    """
    for k in range(end - first):
        y = first + k if downward else end - 1 - k
        back = y - 1 if downward else y + 1
        if 0 <= back < cost.shape[0]:
            there_cost, there_source = (before_cost, before_source) if k == 0 else (cost[back], source[back])
            _step_across(guide[back], guide[y], steps, flags[y], there_cost, there_source, cost[y], source[y])
        _step_along(guide[y], steps, flags[y], cost[y], source[y])


@compiled
def _step_across(
    there: Byte, here: Byte, steps: Float, flags: Byte, there_cost: Float, there_source: Int, cost: Float, source: Int
) -> None:
    width = here.size
    for x in range(width):
        if not flags[x] & _BAND:
            continue
        grey, best, whence = np.int64(here[x]), cost[x], source[x]
        for dx in range(-1, 2):
            if not 0 <= x + dx < width or there_source[x + dx] < 0:
                continue
            way = there_cost[x + dx] + steps[abs(grey - np.int64(there[x + dx]))] + (_DIAGONAL if dx else np.float32(1))
            if way < best:
                best, whence = way, there_source[x + dx]
        cost[x], source[x] = best, whence


@compiled
def _step_along(here: Byte, steps: Float, flags: Byte, cost: Float, source: Int) -> None:
    width = here.size
    for k in range(1, 2 * width - 1):
        x, back = (k, k - 1) if k < width else (2 * width - 2 - k, 2 * width - 1 - k)
        if flags[x] & _BAND and source[back] >= 0:
            way = cost[back] + steps[abs(np.int64(here[x]) - np.int64(here[back]))] + np.float32(1)
            if way < cost[x]:
                cost[x], source[x] = way, source[back]


@compiled
def take_values(
    sites: Float, across: Float, down: Float, holes: Byte, source: Int, columns: Int, parts: Float, rows: Int,
    row_parts: Float, first: int, end: int, out: Float, flags: Byte,
) -> None:  # fmt: skip
    """Write the band of rows `first` .. `end` - 1: the plane of each pixel's source; a band nobody reached has none."""
    w = holes.shape[1]
    for y in range(first, end):
        for x in range(columns.size):
            if not flags[y, x] & _BAND:
                continue
            at = source[y, x]
            if at < 0:
                out[y, x] = np.float32(np.nan)
                continue
            j, i = at // w, at % w
            u, v = np.float32(columns[x] - i) + parts[x], np.float32(rows[y] - j) + row_parts[y]
            out[y, x] = sites[j + RIM, i + RIM] + across[j + RIM, i + RIM] * u + down[j + RIM, i + RIM] * v
            if holes[j, i]:
                flags[y, x] |= np.uint8(4)
