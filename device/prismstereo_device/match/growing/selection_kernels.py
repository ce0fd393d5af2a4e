"""Confidently Stable Matching of the hypotheses in each row, the maximum strict sub-kernel, in one descending pass.

Two hypotheses are rivals where they share their left or their right pixel, or, under the ordering constraint, where they
cross. The matching is the largest set without rivals among itself in which every member t can afford each of its rivals k:
either k correlates less than t by a margin, or k itself is beaten by that margin, by a member that is a rival of k. The margin
is beta, and nothing where t and k belong to the same peak. Whatever beats such a k correlates better than t: so one pass, best
first, has decided on it when it comes to t, and finds the largest set exactly. Equal correlations rank by column, then by
disparity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled, inlined

__all__ = ["BEHIND", "CHOSEN", "LOST", "NONE", "ROW_SHIFT", "listed", "selected"]

NONE, CHOSEN, BEHIND, LOST = range(
    4
)  # of a left pixel: no hypothesis; matched; a nearer match holds its right pixel; beaten
_NEVER = -(1 << 15)
_D_BITS, _X_BITS, _C_BITS = 10, 15, 16  # of a key: row, correlation downwards, column, disparity
ROW_SHIFT = _D_BITS + _X_BITS + _C_BITS  # a key >> ROW_SHIFT is its row
_LOW = (1 << 16) - 1
_X, _D, _C = range(3)  # rows of the hypotheses of one picture row, best first

Ints = NDArray[np.int32]


@compiled
def listed(table: NDArray[np.uint32], count: NDArray[np.uint8], width: int) -> NDArray[np.int64]:
    """Return a key (n,) int64 for each hypothesis of a grown table: sorted, they are by row and best first."""
    total = np.int64(0)
    for p in range(count.size):
        total += np.int64(count[p])
    keys = np.empty(total, np.int64)
    at = 0
    for p in range(count.size):
        for k in range(count[p]):
            entry = np.int64(table[p, k])
            rank = _LOW - (entry >> 16)
            keys[at] = ((((p // width) << _C_BITS | rank) << _X_BITS | (p % width)) << _D_BITS) | (entry & _LOW)
            at += 1
    return keys


@compiled
def _unpack(keys: NDArray[np.int64], start: int, stop: int, found: Ints, head: Ints, chain: Ints) -> None:
    """Spread a row's sorted keys, and chain up those on each left and right pixel, best first."""
    for x in range(head.shape[1]):
        head[0, x] = head[1, x] = -1
    for q in range(stop - start - 1, -1, -1):
        key = keys[start + q]
        d = key & ((1 << _D_BITS) - 1)
        x = (key >> _D_BITS) & ((1 << _X_BITS) - 1)
        found[_X, q], found[_D, q] = x, d
        found[_C, q] = _LOW + _NEVER - ((key >> (_D_BITS + _X_BITS)) & _LOW)
        for side in range(2):
            chain[side, q] = head[side, x - side * d]
            head[side, x - side * d] = q


@compiled
def _affords(found: Ints, head: Ints, chain: Ints, held: Ints, q: int, beta: int, zonegap: int) -> bool:
    """Tell whether hypothesis q can afford each of its rivals."""
    x, d, c = found[_X, q], found[_D, q], found[_C, q]
    for side in range(2):
        k = head[side, x - side * d]
        while k >= 0 and (k <= q or found[_C, k] > c - beta):
            margin = beta if abs(found[_D, k] - d) > zonegap else 0
            weighs = k < q or (k > q and margin > 0)
            if weighs and max(held[0, found[_X, k]], held[1, found[_X, k] - found[_D, k]]) < found[_C, k] + margin:
                return False
            k = chain[side, k]
    return True


@compiled
def _choose(
    found: Ints, n: int, head: Ints, chain: Ints, held: Ints, member: NDArray[np.uint8], settings: Ints
) -> None:
    """Mark the members of one row, where rivals are on the same left or right pixel."""
    for x in range(held.shape[1]):
        held[0, x] = held[1, x] = _NEVER  # the member's correlation on each left and right pixel
    for q in range(n):
        x, right = found[_X, q], found[_X, q] - found[_D, q]
        free = held[0, x] == _NEVER and held[1, right] == _NEVER
        member[q] = free and _affords(found, head, chain, held, q, settings[0], settings[1])
        if member[q]:
            held[0, x] = found[_C, q]
            held[1, right] = found[_C, q]


@inlined
def _rivals(found: Ints, q: int, k: int) -> bool:
    """Tell whether two hypotheses cross or share a pixel."""
    left = found[_X, k] - found[_X, q]
    return bool(left * (left - found[_D, k] + found[_D, q]) <= 0)


@compiled
def _choose_ordered(found: Ints, n: int, member: NDArray[np.uint8], settings: Ints) -> None:
    """Mark the members of one row, where crossing hypotheses are rivals too: every pair is looked at."""
    beta, zonegap = settings[0], settings[1]
    beaten = np.zeros(n, np.int64)  # 1: by a member, 2: by the margin
    for q in range(n):
        member[q] = 1
        for k in range(n):
            if k > q and found[_C, k] <= found[_C, q] - beta:
                break
            another_peak = abs(found[_D, k] - found[_D, q]) > zonegap
            weighs = k < q or (k > q and another_peak)
            if weighs and beaten[k] < (2 if another_peak else 1) and _rivals(found, q, k):
                member[q] = 0
                break
        if member[q]:
            for k in range(n):
                lead = found[_C, q] - found[_C, k]
                if k != q and lead >= 0 and _rivals(found, q, k):
                    beaten[k] = max(beaten[k], 2 if lead >= beta else 1)


@compiled
def _margin(found: Ints, head: Ints, chain: Ints, q: int, zonegap: int) -> int:
    """Return how far a member stands above the best of its rivals of another peak; none counts as no correlation."""
    second = 0
    for side in range(2):
        k = head[side, found[_X, q] - side * found[_D, q]]
        while k >= 0 and abs(found[_D, k] - found[_D, q]) <= zonegap:
            k = chain[side, k]
        if k >= 0:
            second = max(second, found[_C, k])
    return int(found[_C, q] - second)


@compiled
def selected(
    keys: NDArray[np.int64], starts: NDArray[np.int64], settings: Ints,
    chosen: NDArray[np.int16], margin: NDArray[np.int16], standing: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Match some rows, each by itself, and write what became of their pixels.

    `keys`: sorted, those of row y are starts[y] .. starts[y + 1]. `settings` (3,): beta in the unit of the correlations, the
    zonegap, and whether the ordering constraint holds. Written, each (rows, width): `chosen` disparity, -1 where unmatched,
    `margin` above the second best, and `standing`, one of NONE, CHOSEN, BEHIND, LOST.
    """
    rows, width = chosen.shape
    longest = np.int64(0)
    for y in range(rows):
        longest = max(longest, starts[y + 1] - starts[y])
    found, chain = np.empty((3, longest), np.int32), np.empty((2, longest), np.int32)
    head, held = np.empty((2, width), np.int32), np.empty((2, width), np.int32)
    member, nearest = np.empty(longest, np.uint8), np.empty(width, np.int32)
    for y in range(rows):
        n = starts[y + 1] - starts[y]
        _unpack(keys, starts[y], starts[y + 1], found, head, chain)
        if settings[2]:
            _choose_ordered(found, n, member, settings)
        else:
            _choose(found, n, head, chain, held, member, settings)
        for x in range(width):
            chosen[y, x], margin[y, x], standing[y, x], nearest[x] = -1, 0, NONE, -1
        for q in range(n):
            x, d = found[_X, q], found[_D, q]
            standing[y, x] = LOST if standing[y, x] == NONE else standing[y, x]
            if member[q]:
                chosen[y, x], standing[y, x], nearest[x - d] = d, CHOSEN, d
                margin[y, x] = _margin(found, head, chain, q, settings[1])
        for x in range(width):
            if standing[y, x] == LOST:
                d = found[_D, head[0, x]]
                standing[y, x] = BEHIND if nearest[x - d] > d else LOST
