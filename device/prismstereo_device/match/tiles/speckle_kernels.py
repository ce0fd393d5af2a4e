"""Small islands of a map taken away: connected pixels whose disparities follow each other within a pixel.

The same islands as cv2.filterSpeckles finds, by runs: a row is cut into runs with a vector comparison, runs of two rows that
touch are joined (union by size), and runs of too small an island are cleared. Strips of rows work at once; the seams
between strips are joined before anything is cleared.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_any
from prismstereo_device.match.tiles.lanes import PIECES, SHORTS, TILE, Code, Memory, Value, kernel

__all__ = ["clear_small", "find_runs", "join_rows"]

Shorts = NDArray[np.int16]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

_WITHIN = 16  # sixteenths of a pixel


@kernel(arrays=1, numbers=1, returns=True)
def _breaks(code: Code, disparity: Memory, at: Value) -> Value:
    """Tell, a bit each, which of 32 pixels does not go on where the one before it was."""
    found = code.number(0)
    for piece in PIECES:
        here = disparity.load((at + piece) * 2, SHORTS)
        before = disparity.load((at + piece - 1) * 2, SHORTS)
        far = (here - before + _WITHIN) > 2 * _WITHIN
        either, both = here & before, here | before
        border = either.below(0).same(0) & both.below(0)
        apart = far & either.below(0).same(0)
        bits = (apart | border).packed_mask()
        found = found | Value(code.builder, code.builder.shl(bits.ir, code.number(piece).ir))
    return found


@kernel(arrays=0, numbers=1, returns=True)
def _first_bit(_code: Code, bits: Value) -> Value:
    """Return the place of the lowest set bit."""
    return bits.trailing_zeros()


@compiled_any
def _root(parent: Ints, run: int) -> int:
    root = np.int64(run)
    while parent[root] != root:
        parent[root] = parent[parent[root]]
        root = np.int64(parent[root])
    return int(root)


@compiled_any
def _join(parent: Ints, size: Ints, first: int, second: int) -> None:
    one, other = _root(parent, first), _root(parent, second)
    if one != other:
        if size[one] < size[other]:
            one, other = other, one
        parent[other] = one
        size[one] += size[other]


@compiled_any
def join_rows(
    disparity: Shorts, margins: Longs, y: int, above: int, above_end: int, here: int, here_end: int, parent: Ints, size: Ints,
    begins: Ints, ends: Ints,
) -> None:  # fmt: skip
    """Join the runs here .. here_end of row y with those of the row above that touch them."""
    row = y + margins[0]
    while above < above_end and here < here_end:
        for x in range(max(begins[above], begins[here]), min(ends[above], ends[here])):
            column = x + margins[1]
            if abs(np.int32(disparity[row, column]) - np.int32(disparity[row - 1, column])) <= _WITHIN:
                _join(parent, size, np.int64(here), np.int64(above))
                break
        if ends[above] < ends[here]:
            above += 1
        else:
            here += 1


@compiled_any
def find_runs(
    disparity: Shorts, margins: Longs, width: int, begin: int, end: int, run: int, parent: Ints, size: Ints, begins: Ints,
    ends: Ints, rows: Ints,
) -> None:  # fmt: skip
    """Cut the rows begin .. end into runs of matched pixels, numbered from `run`, and join them; rows[y]: the first run of y.

    rows[end] of a strip is written by the next one: its own end is written to rows' second half (rows.size // 2 + y).
    """
    stride, later = disparity.shape[1], rows.size // 2
    for y in range(begin, end):
        rows[y] = run
        at = (y + margins[0]) * stride + margins[1]
        open_run = False
        for left in range(0, width, TILE):
            bits = _breaks(disparity, at + left)
            if left == 0:
                bits |= 1
            while bits != 0:
                x = left + _first_bit(bits)
                bits &= bits - 1
                if x >= width:
                    break
                if open_run:
                    ends[run] = x
                    size[run] = x - begins[run]
                    run += 1
                open_run = disparity[y + margins[0], x + margins[1]] >= 0
                if open_run:
                    parent[run] = run
                    begins[run] = x
        if open_run:
            ends[run] = width
            size[run] = width - begins[run]
            run += 1
        rows[later + y] = run
        if y > begin:
            join_rows(disparity, margins, y, rows[y - 1], rows[later + y - 1], rows[y], run, parent, size, begins, ends)


@compiled_any
def clear_small(
    disparity: Shorts, margins: Longs, begin: int, end: int, parent: Ints, size: Ints, begins: Ints, ends: Ints, rows: Ints,
    smallest: int, reason: int,
) -> None:  # fmt: skip
    """Write `reason`, negative, over the islands of fewer than `smallest` pixels in the rows begin .. end."""
    later = rows.size // 2
    for y in range(begin, end):
        for run in range(rows[y], rows[later + y]):
            root = run
            while parent[root] != root:
                root = parent[root]
            if size[root] < smallest:
                for x in range(begins[run], ends[run]):
                    disparity[y + margins[0], x + margins[1]] = reason
