"""The best label of every pixel: both sums of paths merged, winner, uniqueness, sub-pixel; then the view from the right.

Maps hold sixteenths of a pixel, int16; a negative number is a `Reason` with its sign turned: why there is no match.
The type of the label maps says how wide labels are: bytes up to 256 labels, 16 bits beyond.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_any
from prismstereo_device.match.tiles.census_kernels import transposed
from prismstereo_device.match.tiles.lanes import BYTES, LANES, PIECES, SHORTS, TILE, WORDS, Code, Memory, Value, kernel
from prismstereo_device.match.tiles.path_kernels import LABEL_BYTES
from prismstereo_device.reasons import Reason

__all__ = ["check_rows", "decide_tile", "merge_tile"]

Bytes = NDArray[np.uint8]
Shorts = NDArray[np.int16]
Labels = NDArray[np.uint8] | NDArray[np.uint16]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

_NO_COST = 255
_STEPS = 16
_OUTSIDE, _AMBIGUOUS, _OCCLUDED = -int(Reason.OUTSIDE), -int(Reason.AMBIGUOUS), -int(Reason.OCCLUDED)


@kernel(arrays=6, numbers=6)
def _merge(
    code: Code, down: Memory, across: Memory, merged: Memory, right_cost: Memory, right_label: Memory, edge: Memory,
    at_down: Value, at_across: Value, at_merged: Value, label: Value, place: Value, stride: Value,
) -> None:  # fmt: skip
    """Merge one label of a tile, and offer each sum to the right pixel that it matches; `edge` is 255 beyond the picture."""
    kind = right_label.kind
    name = label.everywhere(kind)
    for left in PIECES:
        beyond = edge.load(code.number(left))
        for top in PIECES:
            lying = [across.load(at_across + (left + row) * TILE + top) for row in range(LANES)]
            for row, values in enumerate(transposed(lying)):
                at = (top + row) * TILE + left
                both = down.load(at_down + at).add_saturating(values) | beyond
                merged.store(at_merged + at, both)
                there = place + stride * (top + row) + left
                best = right_cost.load(there)
                better = both < best
                right_cost.store(there, better.choose(both, best))
                there = there * right_label.bytes_each
                right_label.store(there, better.choose(name, right_label.load(there, kind)))


def _between(code: Code, best: Value, below: Value, above: Value, price: Value) -> Value:
    """Where the winner lies between its neighbours, -8..8 sixteenths: a V through three costs; 0 where one is missing.

    Neighbours of the winner carry the price of a step on each of four paths, which says nothing of the pictures: it is
    taken off first, else every V is steeper than its sides and leans to whole pixels.
    """
    top = below.most(above)
    apart = below.sub_saturating(above) | above.sub_saturating(below)
    rise = (top - best).sub_saturating(price.everywhere(BYTES))
    slope = rise.most(apart).most(code.constant(BYTES, 1)).widened(WORDS).floats()
    lean = ((below.widened(WORDS) - above.widened(WORDS)) << 3).floats(signed=True)
    steps = (lean.over(slope).plus(_STEPS / 2 + 0.5).whole() - _STEPS // 2).narrowed(SHORTS)
    return top.same(_NO_COST).choose(code.constant(SHORTS, 0), steps)


@kernel(arrays=5, numbers=9)
def _decide(
    code: Code, merged: Memory, labels: Memory, disparity: Memory, winner: Memory, margin: Memory, start: Value, count: Value,
    row: Value, at: Value, at_map: Value, unique: Value, column: Value, rival: Value,
    price: Value,
) -> None:  # fmt: skip
    """Decide 32 pixels: the best label, how clear it is, and where between the labels; `unique` in 256ths of the cost.

    A match whose best rival, other than its neighbours, is not dearer by more than that share is ambiguous; `rival` is the
    cost of one that is always there (255: none).
    """
    kind = winner.kind
    for piece in PIECES:
        here = merged.behind(row * TILE + piece)
        cost, label = code.variable(BYTES, _NO_COST), code.variable(kind, 0)
        with code.each(count) as k:
            found = here.load(k * LABEL_BYTES)
            better = found < cost.value
            label.value = better.choose(labels.number(start + k).everywhere(kind), label.value)
            cost.value = better.choose(found, cost.value)
        best, chosen = cost.value, label.value
        below, above, second = (code.variable(BYTES, _NO_COST) for _ in range(3))
        second.value = rival.everywhere(BYTES)
        with code.each(count) as k:
            found = here.load(k * LABEL_BYTES)
            other = labels.number(start + k).everywhere(kind)
            less, more = chosen.sub_saturating(other), other.sub_saturating(chosen)
            below.value = less.same(1).choose(found, below.value)
            above.value = more.same(1).choose(found, above.value)
            second.value = second.value.least(((less | more) > 1).choose(found, _NO_COST))
        lead = second.value.sub_saturating(best)
        share = ((best.widened(SHORTS) * unique.everywhere(SHORTS)) >> 8).narrowed(BYTES)
        wide = chosen.widened(SHORTS)
        steps = (wide << 4) + _between(code, best, below.value, above.value, price)
        steps = steps.below(0).choose(code.constant(SHORTS, 0), steps)
        steps = (lead > share).choose(steps, code.constant(SHORTS, _AMBIGUOUS))
        reach = (column + piece).everywhere(SHORTS) + code.counted(SHORTS)
        steps = reach.below(wide).choose(code.constant(SHORTS, _OUTSIDE), steps)
        disparity.store((at_map + piece) * 2, steps)
        winner.store((at + piece) * winner.bytes_each, chosen)
        margin.store(at + piece, lead)


@kernel(arrays=4, numbers=2)
def _better(
    _code: Code, cost: Memory, label: Memory, other_cost: Memory, other_label: Memory, at: Value, other_at: Value
) -> None:
    """Keep the better one of two winners for 32 right pixels; of equal ones the first."""
    kind = label.kind
    for piece in PIECES:
        mine, other = cost.load(at + piece), other_cost.load(other_at + piece)
        better = other < mine
        cost.store(at + piece, better.choose(other, mine))
        here, there = (at + piece) * label.bytes_each, (other_at + piece) * label.bytes_each
        label.store(here, better.choose(other_label.load(there, kind), label.load(here, kind)))


@kernel(arrays=4, numbers=5)
def _agree(
    code: Code, winner: Memory, seen_right: Memory, labels: Memory, disparity: Memory, start: Value, count: Value, at: Value,
    at_map: Value, at_right: Value,
) -> None:  # fmt: skip
    """Keep those of 32 pixels whose right partner has the same best label or one beside it.

    A loop over the tile's labels instead of a look-up per pixel: each label compares a whole row at once.
    """
    kind = winner.kind
    for piece in PIECES:
        mine = winner.load((at + piece) * winner.bytes_each, kind)
        agreed = code.variable(kind, 0)
        with code.each(count) as k:
            number = labels.number(start + k)
            label = number.everywhere(kind)
            seen = seen_right.load((at_right - number + piece) * winner.bytes_each, kind)
            off = seen.sub_saturating(label) | label.sub_saturating(seen)
            agreed.value = agreed.value | (off <= 1).choose(mine.same(label).choose(code.constant(kind, 1), 0), 0)
        steps = disparity.load((at_map + piece) * 2, SHORTS)
        lost = agreed.value.same(0) & steps.below(0).same(0)
        disparity.store((at_map + piece) * 2, lost.choose(code.constant(SHORTS, _OCCLUDED), steps))


@compiled_any
def merge_tile(
    down: Bytes, across: Bytes, at_across: int, merged: Bytes, right_cost: Bytes, right_label: Labels, place: int, stride: int,
    edge: Bytes, labels: Ints, start: int, count: int,
) -> None:  # fmt: skip
    """Merge both volumes of a tile into `merged`, and keep the best label of each right pixel.

    place, stride: of the tile's first pixel at disparity 0 in the right winners, and from row to row.
    """
    for k in range(count):
        label = labels[start + k]
        at = k * LABEL_BYTES
        _merge(
            down, across, merged, right_cost, right_label, edge, at, at_across + at, at, label, place - label, stride
        )


@compiled_any
def decide_tile(
    merged: Bytes, labels: Ints, start: int, count: int, disparity: Shorts, winner: Labels, margin: Bytes, row: int, rows: int,
    column: int, margins: Longs, unique: int, rival: int, price: int,
) -> None:  # fmt: skip
    """Decide the pixels of a tile whose first one is at row, column; `margins`: rows and columns around `disparity`."""
    for y in range(rows):
        at = (row + y) * winner.shape[1] + column
        at_map = (row + y + margins[0]) * disparity.shape[1] + column + margins[1]
        _decide(merged, labels, disparity, winner, margin, start, count, y, at, at_map, unique, column, rival, price)


@compiled_any
def check_rows(
    right_cost: Bytes, right_label: Labels, places: Longs, firsts: Longs, widths: Longs, labels: Ints, starts: Longs,
    counts: Longs, winner: Labels, disparity: Shorts, margins: Longs, offset: int, height: int, begin: int, end: int,
) -> None:  # fmt: skip
    """Drop what the right picture sees differently in the tile rows begin .. end.

    Each worker kept the right winners of its columns: `places` in the buffers, `firsts` column + offset, `widths`.
    """
    columns = winner.shape[1]
    across = columns // TILE
    cost, label = np.empty(offset + columns, np.uint8), np.empty(offset + columns, right_label.dtype)
    for y in range(begin * TILE, min(end * TILE, height)):
        cost[:] = _NO_COST
        label[:] = 0
        for worker in range(places.size):
            there = places[worker] + y * widths[worker]
            for x in range(0, widths[worker], TILE):
                _better(cost, label, right_cost, right_label, firsts[worker] + x, there + x)
        at_map = (y + margins[0]) * disparity.shape[1] + margins[1]
        for t in range(across):
            c = y // TILE * across + t
            x = t * TILE
            _agree(winner, label, labels, disparity, starts[c], counts[c], y * columns + x, at_map + x, offset + x)
