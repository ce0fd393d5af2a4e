"""Compiled loops that write still pixels: between sites of one surface, and where a side map says which side a pixel is on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling.site_kernels import RIM
from prismstereo.fusion.upsampling.vote_kernels import LANES, near_and_far
from prismstereo_device.compiled import compiled, compiled_any

__all__ = ["interpolate_rows", "mark_filled", "render_cells"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

_FLAT = np.uint8(1)
_BAND = np.uint8(2)
_FILLED = np.uint8(4)
_UNSEEN = np.uint8(8)
_RIGHT = np.uint8(64)
_LOWER = np.uint8(128)
_HALF = np.float32(0.5)
_NOWHERE = np.float32(np.nan)


@compiled
def interpolate_rows(
    sites: Float, columns: Int, parts: Float, rows: Int, row_parts: Float, columns_seen: tuple[int, int],
    rows_seen: tuple[int, int], first: int, end: int, out: Float, flags: Byte,
) -> None:  # fmt: skip
    """Write still rows `first` .. `end` - 1 of `out` and `flags` (H, W) as if everything were one surface.

    `columns`, `parts` (W,) and `rows`, `row_parts` (H,) are the cells of pixels and how far they are into them; outside of
    `columns_seen` and `rows_seen` (first, end) there is no disparity.
    """
    width = columns.size
    begin, stop = columns_seen
    widened = np.empty((2, width), np.float32)  # the two rows of sites around a still row, as wide as the still
    held = -2  # of no row, nor of the one before it
    for y in range(first, end):
        line = out[y]
        if y < rows_seen[0] or y >= rows_seen[1]:
            line[:] = _NOWHERE
            flags[y] = _UNSEEN
            continue
        if held != rows[y]:
            if held == rows[y] - 1:
                widened[0] = widened[1]
            else:
                _widen(sites[rows[y] + RIM], columns, parts, widened[0])
            held = rows[y]
            _widen(sites[held + RIM + 1], columns, parts, widened[1])
        _blend(widened[0], widened[1], row_parts[y], line)
        flags[y] = _FLAT
        line[:begin] = _NOWHERE
        line[stop:] = _NOWHERE
        flags[y, :begin] = _UNSEEN
        flags[y, stop:] = _UNSEEN


@compiled
def _widen(sites: Float, columns: Int, parts: Float, wide: Float) -> None:
    for x in range(columns.size):
        at = np.uintp(columns[np.uintp(x)] + RIM)
        value = sites[at]
        wide[np.uintp(x)] = value + (sites[at + np.uintp(1)] - value) * parts[np.uintp(x)]


@compiled
def _blend(upper: Float, lower: Float, part: np.float32, line: Float) -> None:
    for x in range(line.size):
        at = np.uintp(x)
        line[at] = upper[at] + (lower[at] - upper[at]) * part


@compiled
def mark_filled(
    holes: Byte, columns: Int, parts: Float, rows: Int, row_parts: Float, columns_seen: tuple[int, int],
    first: int, end: int, flags: Byte,
) -> None:  # fmt: skip
    """Mark the pixels of still rows `first` .. `end` - 1 whose nearest site, (h, w), is a hole."""
    for y in range(first, end):
        row = holes[rows[y] + (1 if row_parts[y] >= _HALF else 0)]
        for x in range(columns_seen[0], columns_seen[1]):
            if row[columns[x] + (1 if parts[x] >= _HALF else 0)]:
                flags[y, x] |= _FILLED


@compiled
def _lay_planes(sites: Float, across: Float, down: Float, at: int, stride: int, planes: Float, corners: Int) -> None:
    """Write the planes of a cell's four sites, (12,): value at the cell's first corner, slope across, slope down.

    And for far and near side, and each quarter of the cell, the nearest site on that side: corners (8,).
    """
    one, below = np.uintp(at + 1), np.uintp(at + stride)
    low, high = near_and_far(sites[np.uintp(at)], sites[one], sites[below], sites[below + np.uintp(1)])
    middle = (low + high) * _HALF
    near = 0
    for corner in range(4):
        site = np.uintp(at + (corner >> 1) * stride + (corner & 1))
        near |= (1 << corner) if sites[site] > middle else 0
        value = sites[site]
        value -= across[site] if corner & 1 else np.float32(0)
        value -= down[site] if corner >> 1 else np.float32(0)
        planes[3 * corner], planes[3 * corner + 1], planes[3 * corner + 2] = value, across[site], down[site]
    for quarter in range(4):
        for side in range(2):
            members = near if side else 15 - near
            corner = quarter ^ 3
            corner = quarter ^ 2 if members >> (quarter ^ 2) & 1 else corner
            corner = quarter ^ 1 if members >> (quarter ^ 1) & 1 else corner
            corners[4 * side + quarter] = quarter if members >> quarter & 1 else corner


@compiled
def _mark_corners(holes: Byte, j: int, i: int, marks: Byte) -> None:
    """Write the flags of pixels that take each of the four sites of cell (j, i)."""
    for corner in range(4):
        cy, cx = corner >> 1, corner & 1
        mark = _BAND | (_RIGHT if cx else np.uint8(0)) | (_LOWER if cy else np.uint8(0))
        marks[corner] = mark | (_FILLED if holes[j + cy, i + cx] else np.uint8(0))


@compiled_any
def render_cells(
    sites: Float, across: Float, down: Float, holes: Byte, stride: int, cells: Int, field: Float, side: int,
    starts: Int, spots: Int, shares: Float, parts: Float,
    row_starts: Int, row_spots: Int, row_shares: Float, row_parts: Float, width: int, out: Float, flags: Byte,
) -> None:  # fmt: skip
    """Write the pixels of cells: each takes the plane of the nearest of its cell's sites that lie on the pixel's side.

    `field` (side * side, LANES) is positive on the near side, at places `side` by `side` in the cell; `spots`, `shares` say
    between which of them a pixel lies. Maps and pictures are given row after row, in one array.
    """
    planes, corners, marks = np.zeros(12, np.float32), np.zeros(8, np.int32), np.zeros(4, np.uint8)
    for lane in range(cells.size):
        at = cells[lane]
        j, i = at // stride - RIM, at % stride - RIM
        _lay_planes(sites, across, down, at, stride, planes, corners)
        _mark_corners(holes, j, i, marks)
        first, end = starts[i], starts[i + 1]
        for y in range(row_starts[j], row_starts[j + 1]):
            v, row_share = row_parts[np.uintp(y)], row_shares[np.uintp(y)]
            row = row_spots[np.uintp(y)] * side
            lower = 2 if v > _HALF else 0
            for x in range(first, end):
                u, share = parts[np.uintp(x)], shares[np.uintp(x)]
                spot = np.uintp((row + spots[np.uintp(x)]) * LANES + lane)
                below = spot + np.uintp(side * LANES)
                top = field[spot] + (field[spot + np.uintp(LANES)] - field[spot]) * share
                bottom = field[below] + (field[below + np.uintp(LANES)] - field[below]) * share
                near = 4 if top + (bottom - top) * row_share > np.float32(0) else 0
                corner = corners[np.uintp(near + lower + (1 if u > _HALF else 0))]
                plane, pixel = np.uintp(3 * corner), np.uintp(y * width + x)
                out[pixel] = planes[plane] + planes[plane + np.uintp(1)] * u + planes[plane + np.uintp(2)] * v
                flags[pixel] = marks[np.uintp(corner)]
