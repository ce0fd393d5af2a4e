"""Compiled search for speckles: islands of connected pixels, found as runs of rows that touch each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled

__all__ = ["find_speckles"]

Int = NDArray[np.int32]


@compiled
def find_speckles(values: NDArray[np.float32], largest: int, step: np.float32, taken: NDArray[np.bool_]) -> None:
    """Set `taken` (height, width) where `values` (height, width), NaN for none, form islands of at most `largest`.

    Neighbours along rows and columns that differ by at most `step` are of one island.
    """
    height, width = values.shape
    starts = np.empty(height * width, np.int32)
    ends = np.empty(height * width, np.int32)
    parents = np.empty(height * width, np.int32)
    first_of_row = np.empty(height + 1, np.int32)
    count = 0
    for y in range(height):
        first_of_row[y] = count
        count = _runs(values, y, step, starts, ends, parents, count)
        if y > 0:
            _join(values, y, step, starts, ends, parents, first_of_row[y - 1], first_of_row[y], count)
    first_of_row[height] = count
    sizes = np.zeros(count, np.int32)
    for run in range(count):
        sizes[_root(parents, run)] += ends[run] - starts[run]
    for y in range(height):
        for run in range(first_of_row[y], first_of_row[y + 1]):
            if sizes[_root(parents, run)] <= largest:
                for x in range(starts[run], ends[run]):
                    taken[y, x] = True


@compiled
def _runs(
    values: NDArray[np.float32], y: int, step: np.float32, starts: Int, ends: Int, parents: Int, count: int
) -> int:
    """Append the runs of row `y`, each its own island for now, and return how many there are in all."""
    width = values.shape[1]
    x = 0
    while x < width:
        before = values[y, x]
        if np.isnan(before):
            x += 1
            continue
        starts[count] = x
        x += 1
        while x < width and abs(values[y, x] - before) <= step:
            before = values[y, x]
            x += 1
        ends[count] = x
        parents[count] = count
        count += 1
    return count


@compiled
def _join(
    values: NDArray[np.float32],
    y: int,
    step: np.float32,
    starts: Int,
    ends: Int,
    parents: Int,
    above: int,
    own: int,
    end: int,
) -> None:
    """Join the runs `own` .. `end` of row `y` with those of the row above, `above` .. `own`, that they touch."""
    upper, lower = above, own
    while upper < own and lower < end:
        first = max(starts[upper], starts[lower])
        last = min(ends[upper], ends[lower])
        for x in range(first, last):
            if abs(values[y, x] - values[y - 1, x]) <= step:
                one, other = _root(parents, upper), _root(parents, lower)
                parents[max(one, other)] = min(one, other)
                break
        if ends[upper] < ends[lower]:
            upper += 1
        else:
            lower += 1


@compiled
def _root(parents: Int, run: int) -> int:
    """Return the island of a run, and shorten the way there."""
    while parents[run] != run:
        parents[run] = parents[parents[run]]
        run = parents[run]
    return run
