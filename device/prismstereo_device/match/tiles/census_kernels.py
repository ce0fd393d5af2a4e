"""What a pixel looks like: 31 comparisons of its 9x7 surroundings, the same under any gain and offset.

Each comparison is between two pixels that lie opposite each other (centre-symmetric census). The bits fill four planes of
bytes; the cost of a match is the number of bits that differ, 0..31. Planes are made twice: with 32 columns side by side
for the paths along columns, and transposed, 32 rows side by side, for the paths along rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_any
from prismstereo_device.match.tiles.lanes import BYTES, LANES, PIECES, TILE, Code, Memory, Value, kernel

__all__ = ["EDGE", "OFFSETS", "PLANES", "lay", "look"]

Bytes = NDArray[np.uint8]

EDGE = 8  # pixels around a padded picture, at least half a census window
PLANES = 4
OFFSETS = tuple((0, x) for x in range(1, 5)) + tuple((y, x) for y in range(1, 4) for x in range(-4, 5))
_PLANE_BITS = 8


@kernel(arrays=2, numbers=4)
def _census_row(
    code: Code, picture: Memory, planes: Memory, at: Value, stride: Value, out: Value, plane_bytes: Value
) -> None:
    """Write the four planes of 32 pixels."""
    for piece in PIECES:
        for plane in range(PLANES):
            bits = code.constant(BYTES, 0)
            for bit, (y, x) in enumerate(OFFSETS[plane * _PLANE_BITS : (plane + 1) * _PLANE_BITS]):
                opposite = stride * y + x
                brighter = picture.load(at + piece - opposite) > picture.load(at + piece + opposite)
                bits = bits | brighter.choose(code.constant(BYTES, 1 << bit), 0)
            planes.store(out + piece + plane_bytes * plane, bits)


@kernel(arrays=2, numbers=4)
def transpose(_code: Code, source: Memory, target: Memory, at: Value, stride: Value, out: Value, gap: Value) -> None:
    """Transpose 32x32 bytes; strides are bytes between rows."""
    for top in PIECES:
        for left in PIECES:
            rows = [source.load(at + stride * (top + row) + left) for row in range(LANES)]
            for row, values in enumerate(transposed(rows)):
                target.store(out + gap * (left + row) + top, values)


def transposed(rows: list[Value]) -> list[Value]:
    """Transpose LANES vectors of as many bytes: perfect shuffles, as often as halving takes."""
    half = LANES // 2
    for _ in range(LANES.bit_length() - 1):
        rows = [row for pair in zip(rows[:half], rows[half:], strict=True) for row in pair[0].interleaved(pair[1])]
    return rows


@compiled_any
def look(padded: Bytes, upright: Bytes, lying: Bytes, offset: int, tile_row: int) -> None:
    """Fill the planes of one row of tiles.

    padded: (rows, columns) with EDGE pixels around. upright: (rows, 4, offset + columns), 32 columns side by side.
    lying: (offset + columns, 4, 32), 32 rows side by side, of this row of tiles alone.
    """
    stride, wide = padded.shape[1], upright.shape[2]
    first = tile_row * TILE
    for left in range(0, wide - offset, TILE):
        for y in range(first, first + TILE):
            out = y * PLANES * wide + offset + left
            _census_row(padded, upright, (y + EDGE) * stride + left + EDGE, stride, out, wide)
        at, out = first * PLANES * wide + offset + left, (offset + left) * PLANES * TILE
        for plane in range(PLANES):
            transpose(upright, lying, at + plane * wide, PLANES * wide, out + plane * TILE, PLANES * TILE)


@compiled_any
def lay(padded: Bytes, grey: Bytes, tile_row: int) -> None:
    """Write one row of tiles of a padded picture transposed to grey (columns, 32)."""
    stride = padded.shape[1]
    for left in range(0, grey.shape[0], TILE):
        transpose(padded, grey, (tile_row * TILE + EDGE) * stride + left + EDGE, stride, left * TILE, TILE)
