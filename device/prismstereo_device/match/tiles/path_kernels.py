"""Costs summed along paths: rows to the right and back, columns down and back.

    L(p, d) = C(p, d) + min(L(q, d), L(q, d-1) + P1, L(q, d+1) + P1, min_k L(q, k) + P2) - min_k L(q, k)

for a pixel p that follows q (Hirschmueller 2008). 32 paths lie side by side in a vector, labels are the loop. Every tile
of 32 pixels has its own sorted list of labels; where a path crosses into the next tile, labels find each other by value,
and a label that the tile before did not have counts as ABSENT. P2 is lower where the grey level jumps: depth edges are
mostly seen. All sums fit a byte: L <= 31 + P2, there and back again <= 2 (31 + P2).

Lists are flat: `labels` int32 holds them all, tile c has `counts[c]` of them from `starts[c]` on. Volumes hold a tile's
labels one after the other, LABEL_BYTES apart, 32 steps of 32 lanes each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_any
from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.step_kernels import (
    ABSENT,
    AHEAD,
    DOWN,
    HELD_BYTES,
    LABEL_BYTES,
    LINE,
    LINK_BYTES,
    UP,
    backward_across,
    backward_inside,
    fetch,
    forward_across,
    forward_inside,
)

__all__ = [
    "ABSENT",
    "HELD_BYTES",
    "LABEL_BYTES",
    "LINK_BYTES",
    "ListArrays",
    "backward",
    "begin_paths",
    "buffer_bytes",
    "forward",
    "move_state",
]

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Pair = tuple[int, int]
Planes = tuple[Bytes, Bytes, Bytes]
ListArrays = tuple[Ints, Longs, Longs, Longs]  # labels, starts, counts, volumes
Tables = tuple[Ints, Bytes]  # across, inside

_SKEW = 2048  # the two buffers of a path must not lie whole pages apart: stores would seem to hit loads


def buffer_bytes(most: int) -> int:
    """Return the bytes of one path buffer of at most `most` labels; a path needs two."""
    return -(-(most + 1) * TILE // 4096) * 4096 + _SKEW


@compiled_any
def _link_across(across: Ints, labels: Ints, here: Pair, before: Pair, most: int) -> None:
    """Find each label, the one below and the one above in the list of the tile before; both lists are sorted."""
    (start, count), (start_before, count_before) = here, before
    absent = most * TILE
    j = 0
    for k in range(count):
        label = labels[start + k]
        while j < count_before and labels[start_before + j] < label - 1:
            j += 1
        across[k] = across[most + k] = across[2 * most + k] = absent
        for i in range(j, min(j + 3, count_before)):
            step = labels[start_before + i] - label
            if step == 0:
                across[k] = i * TILE
            elif step == -1:
                across[most + k] = i * TILE
            elif step == 1:
                across[2 * most + k] = i * TILE


@compiled_any
def _link_inside(inside: Bytes, labels: Ints, here: Pair, p1: int, per_label: int) -> None:
    """Write for each label where its right pixel lies, and what it costs to come from the labels before and after in the list.

    That is P1, or all there is where they are not next to each other.
    """
    start, count = here
    words = inside.view(np.int32)
    for k in range(count):
        words[k * (LINK_BYTES // 4)] = labels[start + k] * per_label
        inside[k * LINK_BYTES + DOWN] = inside[k * LINK_BYTES + UP] = 255
        if k > 0 and labels[start + k - 1] == labels[start + k] - 1:
            inside[k * LINK_BYTES + DOWN] = inside[(k - 1) * LINK_BYTES + UP] = p1


@compiled_any
def begin_paths(paths: Bytes, least: Bytes, most: int) -> None:
    """Make both buffers ready for the first pixel of a path: nothing came before it."""
    half = paths.size // 2
    for at in range(paths.size):
        paths[at] = 0
    for lane in range(TILE):
        least[lane] = 0
        paths[most * TILE + lane] = paths[half + most * TILE + lane] = ABSENT


@compiled_any
def move_state(kept: Bytes, place: int, paths: Bytes, least: Bytes, pixel: int, size: int, out: int) -> None:
    """Write down (`out` 1) or bring back (0) where 32 paths are before a pixel, `size` bytes of them."""
    at = pixel % 2 * (paths.size // 2)
    for lane in range(TILE):
        if out:
            kept[place + lane] = least[lane]
        else:
            least[lane] = kept[place + lane]
    for i in range(size):
        if out:
            kept[place + TILE + i] = paths[at + i]
        else:
            paths[at + i] = kept[place + TILE + i]


@compiled_any
def forward(
    sides: Planes, places: Longs, strides: Longs, lists: ListArrays, tile: int, begin: int, end: int,
    penalties: Longs, tables: Tables, paths: Bytes, least: Bytes, held: Bytes,
) -> int:  # fmt: skip
    """Walk 32 paths from pixel `begin`, where a tile begins, to `end`; return the bytes filled in `held`.

    sides: left planes, right planes, grey. places: of the path's first pixel in these (bytes). strides: from pixel to pixel in
    them, from plane to plane in left, right, and per label in right (bytes), and from tile to tile. tile: the path's first.
    """
    left, right, grey = sides
    labels, starts, counts, _ = lists
    across, inside = tables
    most, half = inside.size // LINK_BYTES, paths.size // 2
    p1, p2, p2_low = penalties
    tile_step = strides[6]
    cell = 0
    for pixel in range(begin, end):
        c = tile + pixel // TILE * tile_step
        count, start = counts[c], starts[c]
        at_left, at_right = places[0] + pixel * strides[0], places[1] + pixel * strides[1]
        here = places[2] + pixel * strides[2]
        grey_before = here - strides[2] if pixel > 0 else here
        before = pixel % 2 * half
        crosses = False
        if strides[5] == 1:  # labels lie side by side: this walks down
            lowest = labels[start + count - 1]
            lines = (lowest - labels[start] + TILE) // LINE + 2
            fetch(
                left, right, grey, at_left + AHEAD * strides[0], strides[3], at_right - lowest + AHEAD * strides[1],
                strides[4], lines, here + AHEAD * strides[2],
            )  # fmt: skip
        if pixel % TILE == 0:
            _link_inside(inside, labels, (start, count), p1, strides[5])
            crosses = pixel > 0 and starts[c - tile_step] != start
            if crosses:
                _link_across(across, labels, (start, count), (starts[c - tile_step], counts[c - tile_step]), most)
        if crosses:
            forward_across(
                left, right, inside, across, paths, least, held, grey, count, most, at_left, strides[3], at_right, strides[4],
                cell, before, half - before, p1, p2, p2_low, here, grey_before,
            )  # fmt: skip
        else:
            forward_inside(
                left, right, inside, across, paths, least, held, grey, count, most, at_left, strides[3], at_right, strides[4],
                cell, before, half - before, p1, p2, p2_low, here, grey_before,
            )  # fmt: skip
        cell += count * HELD_BYTES
    return cell


@compiled_any
def backward(
    grey: Bytes, place: int, strides: Longs, lists: ListArrays, tile: int, done: int, steps: int, penalties: Longs,
    tables: Tables, paths: Bytes, least: Bytes, held: Bytes, cell: int, volume: Bytes, out: int,
) -> None:  # fmt: skip
    """Walk 32 paths back through the last `steps` pixels of a tile, coming from the tile after it.

    place: of the tile's first pixel in grey; strides: as for `forward`; done: pixels that the path has come already;
    cell: the end of the tile in `held`. Both ways summed go to volume[out ...].
    """
    labels, starts, counts, _ = lists
    across, inside = tables
    most, half = inside.size // LINK_BYTES, paths.size // 2
    count, start = counts[tile], starts[tile]
    p1, p2, p2_low = penalties
    _link_inside(inside, labels, (start, count), p1, strides[5])
    after = tile + strides[6] if done > 0 else tile
    crosses = starts[after] != start
    if crosses:
        _link_across(across, labels, (start, count), (starts[after], counts[after]), most)
    for step in range(steps - 1, -1, -1):
        cell -= count * HELD_BYTES
        here = place + step * strides[2]
        grey_before = here if done == 0 else here + strides[2]
        before = done % 2 * half
        if crosses:
            backward_across(
                inside, across, paths, least, held, volume, grey, count, most, cell, out + step * TILE, before, half - before,
                p1, p2, p2_low, here, grey_before,
            )  # fmt: skip
            crosses = False
        else:
            backward_inside(
                inside, across, paths, least, held, volume, grey, count, most, cell, out + step * TILE, before, half - before,
                p1, p2, p2_low, here, grey_before,
            )  # fmt: skip
        done += 1
