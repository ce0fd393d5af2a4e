"""Which labels each tile tries: those that the coarse map, and the map of the frame before, show around it.

A label counts with its neighbours (+-1). Where the coarse pass had a winner left of the right picture, that label is
tried too: no match is there, but it holds its place against false ones. A tile with no label at all keeps label 0, so
that paths can cross it, and is not `known`: all of it stays unmatched.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_any
from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.path_kernels import LABEL_BYTES, ListArrays

__all__ = ["list_labels"]

Bytes = NDArray[np.uint8]
Shorts = NDArray[np.int16]
Labels = NDArray[np.uint8] | NDArray[np.uint16]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Floats = NDArray[np.float32]

_STEPS = 16
_HINT_STRIDE = 2


@compiled_any
def _count_coarse(
    votes: Ints,
    coarse: Shorts,
    winner: Labels,
    margins: Longs,
    scale: Longs,
    size: Longs,
    row: int,
    column: int,
    grown: int,
) -> None:
    """Count the labels that the coarse map, `scale` (y, x) times smaller and of `size`, shows in a tile and around it."""
    high, wide = TILE // scale[0], TILE // scale[1]
    for y in range(max(0, row * high - grown), min(size[0], row * high + high + grown)):
        for x in range(max(0, column * wide - grown), min(size[1], column * wide + wide + grown)):
            steps = np.int64(coarse[y + margins[0], x + margins[1]])
            if steps < 0:
                label = np.int64(winner[y, x])
                if label <= x:
                    continue
                steps = label * _STEPS
            votes[min((steps * scale[1] + _STEPS // 2) // _STEPS, votes.size - 1)] += 1


@compiled_any
def _count_hint(votes: Ints, hint: Floats, first: int, row: int, column: int) -> None:
    """Count the labels that the map of the frame before shows in a tile; labels begin at `first`."""
    for y in range(row * TILE, min(row * TILE + TILE, hint.shape[0]), _HINT_STRIDE):
        for x in range(column * TILE, min(column * TILE + TILE, hint.shape[1]), _HINT_STRIDE):
            value = hint[y, x]
            if value >= first and value <= first + votes.size - 1:
                votes[np.int64(value + np.float32(0.5)) - first] += 1


@compiled_any
def _keep_most(wanted: Ints, votes: Ints, room: int) -> None:
    """Unmark labels until at most `room` are wanted: those with the fewest votes, of equal ones the largest."""
    total = 0
    for label in range(wanted.size):
        total += wanted[label]
    while total > room:
        worst = -1
        for label in range(wanted.size):
            if wanted[label] and (worst < 0 or votes[label] <= votes[worst]):
                worst = label
        wanted[worst] = 0
        total -= 1


@compiled_any
def _list_tile(
    votes: Ints,
    hinted: Ints,
    wanted: Ints,
    fewest: int,
    fewest_hint: int,
    room: int,
    lists: ListArrays,
    known: Bytes,
    c: int,
) -> None:
    """Write the list of tile c by the votes for its labels."""
    labels, starts, counts, _ = lists
    for label in range(votes.size):
        wanted[label] = 0
    for label in range(votes.size):
        if votes[label] >= fewest or hinted[label] >= fewest_hint:
            for beside in range(max(label - 1, 0), min(label + 2, votes.size)):
                wanted[beside] = 1
    for label in range(votes.size):
        votes[label] += hinted[label]
    _keep_most(wanted, votes, room)
    n = 0
    for label in range(votes.size):
        if wanted[label]:
            labels[starts[c] + n] = label
            n += 1
    known[c] = n > 0
    if n == 0:
        labels[starts[c]] = 0
        n = 1
    counts[c] = n


@compiled_any
def list_labels(
    coarse: Shorts, winner: Labels, margins: Longs, scale: Longs, size: Longs, hint: Floats, first: int, needs: Longs,
    row_bytes: int, tiles: int, lists: ListArrays, known: Bytes, count: int, room: int, begin: int, end: int,
) -> None:  # fmt: skip
    """Write the lists of the tile rows begin .. end, of labels 0 .. count - 1, `room` at most in a tile.

    needs: the coarse pixels around a tile that vote, the votes of coarse pixels, or of the hint, that make a label wanted (an
    empty hint has none). A tile row has `row_bytes` in the volume; lists that are too long for that lose their rarest labels.
    """
    grown, fewest, fewest_hint = needs
    votes, hinted, wanted = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.int32)
    counts, volumes = lists[2], lists[3]
    for row in range(begin, end):
        most, place = room, row_bytes + 1
        while place > row_bytes:
            place = 0
            for column in range(tiles):
                c = row * tiles + column
                for label in range(count):
                    votes[label] = hinted[label] = 0
                _count_coarse(votes, coarse, winner, margins, scale, size, row, column, grown)
                _count_hint(hinted, hint, first, row, column)
                _list_tile(votes, hinted, wanted, fewest, fewest_hint, most, lists, known, c)
                volumes[c] = row * row_bytes + place
                place += counts[c] * LABEL_BYTES
            most = max(most * 3 // 4, 1)
