"""Growing: correlate windows, grow hypotheses best first, match seeds along rows, and refine to fractions of a pixel.

Pictures lie flat, (2, height * width) for left and right, with `MARGIN_PX` unused pixels on every side. A hypothesis is a left
pixel's place p = y * width + x and a disparity d; its right pixel is p - d. Correlations are whole numbers, `ONE` for 1.0:
they compare and sort the same on every machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled, inlined

__all__ = ["FRACTION", "MARGIN_PX", "NEVER", "ONE", "grow", "matched_along_rows", "refined"]

MARGIN_PX = 3
ONE = 1 << 14
NEVER = -(1 << 15)  # below every correlation
FRACTION = 16  # steps per pixel of a refined disparity
_HALF_PX = 2  # windows of 5x5
_BUCKET_BITS = 6  # correlations that agree but for these bits wait in one bucket, the last come served first
_BUCKETS = (2 * ONE >> _BUCKET_BITS) + 1
_FREE = _BUCKETS  # the head of the free nodes stands behind those of the buckets
_SLOTS = 8  # correlations remembered per left pixel, found by the low bits of their disparity
_D_BITS = 16
_LOW = (1 << _D_BITS) - 1

# the sixteen neighbours of a hypothesis, (columns, rows, disparities) away, four neighbourhoods one after the other
_STEPS = np.array(
    [
        (-1, 0, 0), (-2, 0, -1), (-1, 0, 1),
        (1, 0, 0), (2, 0, 1), (1, 0, -1),
        (0, -1, 0), (1, -1, 1), (-1, -1, -1), (0, -1, -1), (0, -1, 1),
        (0, 1, 0), (1, 1, 1), (-1, 1, -1), (0, 1, -1), (0, 1, 1),
    ],
    np.int64,
)  # fmt: skip
_ENDS = np.array([0, 3, 6, 11, 16], np.int64)

Bytes = NDArray[np.uint8]
Sums = NDArray[np.int32]


@inlined
def _correlation(pictures: Bytes, sums: Sums, powers: Sums, p: int, q: int, width: int, half: int, floor: float) -> int:
    """Return 2 cov / (var + var + floor) of the windows around left pixel p and right pixel q."""
    total = np.int64(0)
    for row in range(-half, half + 1):
        a = p + row * width - half
        b = q + row * width - half
        for column in range(2 * half + 1):
            total += np.int64(pictures[0, np.uintp(a + column)]) * np.int64(pictures[1, np.uintp(b + column)])
    pixels = (2 * half + 1) ** 2
    covariance = pixels * total - np.int64(sums[0, np.uintp(p)]) * np.int64(sums[1, np.uintp(q)])
    whole = float(powers[0, np.uintp(p)]) + float(powers[1, np.uintp(q)]) + floor
    if whole <= 0:
        return 0
    return int(np.rint(2.0 * ONE * float(covariance) / whole))


@inlined
def _remembered(
    pictures: Bytes, sums: Sums, powers: Sums, memory: NDArray[np.uint32], p: int, d: int, width: int, floor: float
) -> int:
    """Return the correlation of hypothesis (p, d), from memory where it is still there."""
    slot = np.uintp(p * _SLOTS + (d & (_SLOTS - 1)))
    entry = np.int64(memory[slot])
    if entry >> _D_BITS == d + 1:
        return int((entry & _LOW) + NEVER)
    found = _correlation(pictures, sums, powers, p, p - d, width, _HALF_PX, floor)
    memory[slot] = np.uint32(((d + 1) << _D_BITS) | (found - NEVER))
    return found


@inlined
def _best_neighbour(
    pictures: Bytes, sums: Sums, powers: Sums, memory: NDArray[np.uint32],
    p: int, x: int, d: int, width: int, floor: float, first: int, labels: int, which: int,
) -> tuple[int, int, int, int]:  # fmt: skip
    """Return place, disparity and correlation of the best hypothesis in one neighbourhood, and the second best correlation."""
    end = pictures.shape[1] - MARGIN_PX * width
    best_p, best_d, best, second = 0, 0, NEVER, NEVER
    for k in range(_ENDS[which], _ENDS[which + 1]):
        column = x + _STEPS[k, 0]
        near_p = p + _STEPS[k, 0] + _STEPS[k, 1] * width
        near_d = d + _STEPS[k, 2]
        if near_d < first or near_d >= labels or near_p < MARGIN_PX * width or near_p >= end:
            continue
        if column < MARGIN_PX or column >= width - MARGIN_PX:
            continue
        if column - near_d < MARGIN_PX or column - near_d >= width - MARGIN_PX:
            continue
        found = _remembered(pictures, sums, powers, memory, near_p, near_d, width, floor)
        if found > best:
            best_p, best_d, best, second = near_p, near_d, found, best
        elif found > second:
            second = found
    return best_p, best_d, best, second


@inlined
def _known(table: NDArray[np.uint32], count: Bytes, p: int, d: int) -> bool:
    known = False
    for k in range(count[np.uintp(p)]):
        known |= np.int64(table[np.uintp(p), np.uintp(k)]) & _LOW == d
    return known


@inlined
def _push(heads: Sums, nodes: NDArray[np.int64], after: Sums, p: int, d: int, correlation: int) -> int:
    """Queue a hypothesis and return its bucket; there must be a free node."""
    bucket = (correlation + ONE) >> _BUCKET_BITS
    node = heads[_FREE]
    heads[_FREE] = after[node]
    nodes[node] = (p << _D_BITS) | d
    after[node] = heads[bucket]
    heads[bucket] = node
    return bucket


@inlined
def _pop(heads: Sums, nodes: NDArray[np.int64], after: Sums, bucket: int) -> int:
    """Take the hypothesis out that came last into a bucket; its node is free again."""
    node = heads[bucket]
    heads[bucket] = after[node]
    after[node] = heads[_FREE]
    heads[_FREE] = node
    return int(nodes[node])


@compiled
def _longer(heads: Sums, nodes: NDArray[np.int64], after: Sums) -> tuple[NDArray[np.int64], Sums]:
    """Return the queue's nodes at twice the length, the new half free."""
    size = nodes.size
    more_nodes, more_after = np.empty(2 * size, np.int64), np.empty(2 * size, np.int32)
    for node in range(size):
        more_nodes[node] = nodes[node]
        more_after[node] = after[node]
    for node in range(size, 2 * size):
        more_after[node] = heads[_FREE]
        heads[_FREE] = node
    return more_nodes, more_after


@inlined
def _accepts(
    table: NDArray[np.uint32], count: Bytes, best: NDArray[np.uint16],
    p: int, d: int, found: int, second: int, tau: int, mu: int, single: bool, epsilon: int,
) -> bool:  # fmt: skip
    """Tell whether growth goes on to the best hypothesis (p, d) of a neighbourhood."""
    left, right = np.int64(best[0, np.uintp(p)]) + NEVER, np.int64(best[1, np.uintp(p - d)]) + NEVER
    if found < tau or found == NEVER or (found + mu < left and found + mu < right):
        return False
    if single and (left > NEVER or right > NEVER or found - second < epsilon):
        return False
    return bool(count[np.uintp(p)] < table.shape[1]) and not _known(table, count, p, d)


@inlined
def _add(table: NDArray[np.uint32], count: Bytes, best: NDArray[np.uint16], p: int, d: int, found: int) -> None:
    table[np.uintp(p), np.uintp(count[np.uintp(p)])] = ((found - NEVER) << _D_BITS) | d
    count[np.uintp(p)] += 1
    best[0, np.uintp(p)] = max(np.int64(best[0, np.uintp(p)]), np.int64(found - NEVER))
    best[1, np.uintp(p - d)] = max(np.int64(best[1, np.uintp(p - d)]), np.int64(found - NEVER))


@compiled
def grow(
    pictures: Bytes, sums: Sums, powers: Sums, floor: float, width: int, first: int, labels: int,
    seeds: NDArray[np.int64], tau: int, mu: int, most: int, single: bool, epsilon: int,
) -> tuple[NDArray[np.uint32], Bytes]:  # fmt: skip
    """Grow the seeds, (n, 2) int64 of place and disparity inside the margin, and return every hypothesis accepted.

    A table (height * width, most) uint32, correlation - NEVER in the high 16 bits and disparity in the low ones, and how many
    there are on each left pixel, (height * width,) uint8. `tau`, `mu` and `epsilon` are in units of 1 / ONE. `single`: one
    hypothesis per left and right pixel, which stands `epsilon` above the second best of its neighbourhood (dgrow0).
    """
    size = pictures.shape[1]
    table, count = np.empty((size, most), np.uint32), np.zeros(size, np.uint8)
    memory = np.zeros(size * _SLOTS, np.uint32)
    best = np.zeros((2, size), np.uint16)  # on each left and right pixel so far, counted from NEVER
    heads = np.empty(_FREE + 1, np.int32)
    for bucket in range(_FREE + 1):
        heads[bucket] = -1
    nodes, after = _longer(heads, np.empty(seeds.shape[0] + 512, np.int64), np.empty(seeds.shape[0] + 512, np.int32))
    waiting, top = seeds.shape[0], _FREE - 1
    for k in range(waiting):
        p, d = seeds[k, 0], seeds[k, 1]
        _push(heads, nodes, after, p, d, _remembered(pictures, sums, powers, memory, p, d, width, floor))
    while waiting > 0:
        while heads[top] < 0:
            top -= 1
        if waiting + 4 > nodes.size // 2:
            nodes, after = _longer(heads, nodes, after)
        popped = _pop(heads, nodes, after, top)
        centre, x = popped >> _D_BITS, (popped >> _D_BITS) % width
        waiting -= 1
        for which in range(4):
            p, d, found, second = _best_neighbour(
                pictures, sums, powers, memory, centre, x, popped & _LOW, width, floor, first, labels, which
            )
            if _accepts(table, count, best, p, d, found, second, tau, mu, single, epsilon):
                _add(table, count, best, p, d, found)
                top = max(top, _push(heads, nodes, after, p, d, found))
                waiting += 1
    return table, count


@compiled
def matched_along_rows(
    pictures: Bytes, sums: Sums, powers: Sums, floor: float, width: int, half: int, first: int, labels: int,
    places: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """Return the disparity of the best correlation in the whole range and that correlation for each left place (n,) int64.

    Windows have 2 half + 1 pixels a side, half <= MARGIN_PX; where nothing is in range the correlation is NEVER.
    """
    disparities, correlations = np.zeros(places.size, np.int64), np.empty(places.size, np.int64)
    for k in range(places.size):
        p = places[k]
        x = p % width
        correlations[k] = NEVER
        for d in range(max(first, x - (width - MARGIN_PX - 1)), min(labels, x - MARGIN_PX + 1)):
            found = _correlation(pictures, sums, powers, p, p - d, width, half, floor)
            if found > correlations[k]:
                disparities[k], correlations[k] = d, found
    return disparities, correlations


@compiled
def refined(
    pictures: Bytes,
    sums: Sums,
    powers: Sums,
    floor: float,
    width: int,
    first: int,
    labels: int,
    chosen: NDArray[np.int16],
) -> NDArray[np.int16]:
    """Return disparities in sixteenths, the top of the parabola through the correlations at d - 1, d and d + 1.

    `chosen` (height * width,) int16 are whole disparities, negative where unmatched; these become -FRACTION. A top beyond half
    a pixel belongs to a neighbour that another pixel holds: half a pixel it is. None leaves `first` .. `labels` - 1.
    """
    steps, peak = np.empty(chosen.size, np.int16), np.empty(3, np.int64)
    for p in range(chosen.size):
        d = np.int64(chosen[p])
        steps[p] = -FRACTION
        if d < 0:
            continue
        for k in range(3):
            peak[k] = _correlation(pictures, sums, powers, p, int(p - d + 1 - k), width, _HALF_PX, floor)
        before, here, beyond = peak[0], peak[1], peak[2]
        bend = 2 * here - before - beyond
        shift = 0.0
        if bend > 0:
            shift = min(max((beyond - before) / (2.0 * bend), -0.5), 0.5)
        found = int(np.rint(FRACTION * (float(d) + shift)))
        steps[p] = min(max(found, FRACTION * first), FRACTION * (labels - 1))
    return steps
