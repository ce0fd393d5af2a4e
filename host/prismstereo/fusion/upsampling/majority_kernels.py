"""Compiled loops that find the pixels of the band that most of their 5x5 neighbours disagree with, and their median."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling.site_kernels import RIM
from prismstereo_device.compiled import compiled, compiled_any

__all__ = ["LEAST_SIDE", "find_medians", "find_outvoted", "replace_outvoted"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

_REACH = 2
_SIDE = 2 * _REACH + 1
_AREA = _SIDE * _SIDE
_CHUNK = 16  # pixels of a row that are looked at together
LEAST_SIDE = _CHUNK + 2 * _REACH
_MOST = 13  # of 25
_BAND = np.uint8(2)
_FILLED = np.uint8(4)


@compiled
def _count_alike(out: Float, width: int, start: int, reach: np.float32, counts: Int) -> None:
    """Write to counts (_CHUNK,) how many of the 25 pixels around each from `start` on, row after row, are like it."""
    for k in range(_CHUNK):
        at = np.uintp(start + k)
        middle = out[at]
        many = np.int32(0)
        for dy in range(_SIDE):
            line = at + np.uintp((dy - _REACH) * width) - np.uintp(_REACH)
            for dx in range(_SIDE):
                many += np.int32(abs(out[line + np.uintp(dx)] - middle) < reach)
        counts[np.uintp(k)] = many


@compiled_any
def find_outvoted(
    out: Float, cells: Int, stride: int, starts: Int, row_starts: Int, reach: np.float32,
    seen: tuple[int, int, int, int], found: Int,
) -> int:  # fmt: skip
    """Write the outvoted pixels of `cells` (N,), row after row of them, and return how many there are.

    Outvoted is a pixel of which 13 of the 25 around it differ by `reach` or more. `seen` (top, bottom, left, right) is what
    has disparity, at least `LEAST_SIDE` each way; two pixels at its rim stay as they are.
    """
    top, bottom, left, right = seen
    counts, pixels, width = np.zeros(_CHUNK, np.int32), out.reshape(-1), out.shape[1]
    total, k = 0, 0
    while k < cells.size:
        last = k
        while last + 1 < cells.size and cells[last + 1] == cells[last] + 1:
            last += 1
        j, i = cells[k] // stride - RIM, cells[k] % stride - RIM
        begin, end = max(starts[i], left + _REACH), min(starts[i + last - k + 1], right - _REACH)
        for y in range(max(row_starts[j], top + _REACH), min(row_starts[j + 1], bottom - _REACH)):
            for x in range(begin, end, _CHUNK):
                x0 = min(x, right - _REACH - _CHUNK)
                _count_alike(pixels, width, y * width + x0, reach, counts)
                for at in range(x, min(x0 + _CHUNK, end)):
                    if counts[at - x0] < _MOST:
                        found[total] = y * width + at
                        total += 1
        k = last + 1
    return total


@compiled
def find_medians(out: Float, found: Int, medians: Float) -> None:
    """Write the median of the 5x5 around each of the pixels `found` (N,); `out` is only read."""
    pixels, width = out.reshape(-1), out.shape[1]
    windows, middles = np.zeros(_AREA * _CHUNK, np.float32), np.zeros(_CHUNK, np.float32)
    for begin in range(0, found.size, _CHUNK):
        count = min(_CHUNK, found.size - begin)
        for k in range(count):
            corner = found[begin + k] - _REACH * width - _REACH
            for dy in range(_SIDE):
                for dx in range(_SIDE):
                    windows[np.uintp((dy * _SIDE + dx) * _CHUNK + k)] = pixels[np.uintp(corner + dy * width + dx)]
        middles[:] = -np.inf
        for at in range(0, _AREA * _CHUNK, _CHUNK):
            _raise_to(windows, at, middles)
        medians[begin : begin + count] = middles[:count]


@compiled
def _raise_to(windows: Float, at: int, middles: Float) -> None:
    """Raise the middles to one value of each window, if fewer than 13 are below it: the largest such value is the median."""
    for k in range(_CHUNK):
        value = windows[np.uintp(at + k)]
        below = np.int32(0)
        for other in range(_AREA):
            below += np.int32(windows[np.uintp(other * _CHUNK + k)] < value)
        middle = middles[np.uintp(k)]
        middles[np.uintp(k)] = value if (below < _MOST) & (value > middle) else middle


@compiled_any
def replace_outvoted(
    sites: Float, holes: Byte, columns: Int, rows: Int, found: Int, medians: Float, out: Float, flags: Byte
) -> None:
    """Write the medians where they belong, and as their site the one of the cell that comes nearest."""
    width = out.shape[1]
    for k in range(found.size):
        y, x = found[k] // width, found[k] % width
        j, i = rows[y], columns[x]
        best, least = 0, np.float32(np.inf)
        for corner in range(4):
            apart = abs(sites[j + RIM + (corner >> 1), i + RIM + (corner & 1)] - medians[k])
            if apart < least:
                best, least = corner, apart
        out[y, x] = medians[k]
        flags[y, x] = np.uint8(_BAND | best << 6 | (_FILLED if holes[j + (best >> 1), i + (best & 1)] else 0))
