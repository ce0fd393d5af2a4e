"""Compiled loops over cells across a depth edge, `LANES` of them side by side: split, collect, and let the sites vote.

A cell's four sites are split into a near and a far side at the largest gap between them. All sites around it then vote for the
side they lie on, at places inside the cell, by how alike their colours are. One flat array of float32 per kind holds
everything in lanes, the cell fastest; sums run over sites in a fixed order, and nothing is regrouped: the bits are the same for
any number of threads and any width of vectors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled

__all__ = ["LANES", "collect_labels", "collect_sites", "near_and_far", "vote_at"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

LANES = 64
_ZERO = np.float32(0)
_ONE = np.float32(1)
_HALF = np.float32(0.5)
_LABEL_LIMIT = np.float32(1.5)
_BY = 4  # sites that are summed before the sums are put away


@compiled
def near_and_far(a: np.float32, b: np.float32, c: np.float32, d: np.float32) -> tuple[np.float32, np.float32]:
    """Return the two neighbours in the sorted row of four values that lie farthest apart, the lower first."""
    s0, s1, s2, s3 = min(a, b), max(a, b), min(c, d), max(c, d)
    least, most = min(s0, s2), max(s1, s3)
    p, q = max(s0, s2), min(s1, s3)
    second, third = min(p, q), max(p, q)
    low, high = least, second
    if third - second > high - low:
        low, high = second, third
    if most - third > high - low:
        low, high = third, most
    return low, high


@compiled
def collect_sites(sites: Float, colours: Float, cells: Int, offsets: Int, middles: Float, votes: Float) -> None:
    """Write side (-1 far, 1 near) and colour of each cell's sites: (offsets, planes + 1, LANES).

    `cells` (LANES,) are the upper left sites; `offsets` (N,) lead from there to the sites that vote.
    """
    planes = colours.size // sites.size
    for t in range(offsets.size):
        step = offsets[t]
        out = t * (planes + 1) * LANES
        for lane in range(LANES):
            at = np.uintp(cells[np.uintp(lane)] + step)
            votes[np.uintp(out + lane)] = _ONE if sites[at] > middles[np.uintp(lane)] else -_ONE
        for z in range(planes):
            out += LANES
            plane = z * sites.size + step
            for lane in range(LANES):
                votes[np.uintp(out + lane)] = colours[np.uintp(cells[np.uintp(lane)] + plane)]


@compiled
def collect_labels(sites: Float, cells: Int, stride: int, middles: Float, halves: Float, labels: Float) -> None:
    """Write how far on the near (+) or far (-) side the 4x4 sites around each cell lie: (16, LANES), within 1.5."""
    for k in range(16):
        step = (k // 4 - 1) * stride + k % 4 - 1
        for lane in range(LANES):
            at = np.uintp(lane)
            value = (sites[np.uintp(cells[at] + step)] - middles[at]) / halves[at]
            labels[np.uintp(k * LANES + lane)] = min(max(value, -_LABEL_LIMIT), _LABEL_LIMIT)


@compiled
def vote_at(place: Float, votes: Float, weights: Float, narrow: np.float32, wide: np.float32, sums: Float) -> None:
    """Let all sites vote at one place of each cell: sums (4, LANES) of votes and weights for the narrow and the wide range.

    `place` (planes, LANES) are the colours there, `weights` (N,) how near the sites are, N a multiple of 4; `narrow` and
    `wide` are one over the square of the summed colour difference at which a site has nothing to say.
    """
    sums[: 4 * LANES] = _ZERO
    if place.size == LANES:
        for t in range(0, weights.size, _BY):
            _vote_grey(place, votes, t, weights, narrow, wide, sums)
    else:
        for t in range(0, weights.size, _BY):
            _vote_colour(place, votes, t, weights, narrow, wide, sums)


@compiled
def _vote_colour(
    place: Float, votes: Float, first: int, weights: Float, narrow: np.float32, wide: np.float32, sums: Float
) -> None:
    w0, w1, w2, w3 = weights[first], weights[first + 1], weights[first + 2], weights[first + 3]
    base = first * 4 * LANES
    for lane in range(LANES):
        blue, green, red = place[np.uintp(lane)], place[np.uintp(LANES + lane)], place[np.uintp(2 * LANES + lane)]
        n0, m0 = sums[np.uintp(lane)], sums[np.uintp(LANES + lane)]
        n1, m1 = sums[np.uintp(2 * LANES + lane)], sums[np.uintp(3 * LANES + lane)]
        for k in range(_BY):
            at = np.uintp(base + k * 4 * LANES + lane)
            weight = w0 if k == 0 else (w1 if k == 1 else (w2 if k == 2 else w3))
            side = votes[at]
            apart = abs(blue - votes[at + np.uintp(LANES)]) + abs(green - votes[at + np.uintp(2 * LANES)])
            apart += abs(red - votes[at + np.uintp(3 * LANES)])
            apart *= apart
            z = max(_ONE - apart * narrow, _ZERO)
            z = z * z * weight
            n0 += side * z
            m0 += z
            z = max(_ONE - apart * wide, _ZERO)
            z = z * z * weight
            n1 += side * z
            m1 += z
        sums[np.uintp(lane)], sums[np.uintp(LANES + lane)] = n0, m0
        sums[np.uintp(2 * LANES + lane)], sums[np.uintp(3 * LANES + lane)] = n1, m1


@compiled
def _vote_grey(
    place: Float, votes: Float, first: int, weights: Float, narrow: np.float32, wide: np.float32, sums: Float
) -> None:
    w0, w1, w2, w3 = weights[first], weights[first + 1], weights[first + 2], weights[first + 3]
    base = first * 2 * LANES
    for lane in range(LANES):
        grey = place[np.uintp(lane)]
        n0, m0 = sums[np.uintp(lane)], sums[np.uintp(LANES + lane)]
        n1, m1 = sums[np.uintp(2 * LANES + lane)], sums[np.uintp(3 * LANES + lane)]
        for k in range(_BY):
            at = np.uintp(base + k * 2 * LANES + lane)
            weight = w0 if k == 0 else (w1 if k == 1 else (w2 if k == 2 else w3))
            side = votes[at]
            apart = grey - votes[at + np.uintp(LANES)]
            apart *= apart
            z = max(_ONE - apart * narrow, _ZERO)
            z = z * z * weight
            n0 += side * z
            m0 += z
            z = max(_ONE - apart * wide, _ZERO)
            z = z * z * weight
            n1 += side * z
            m1 += z
        sums[np.uintp(lane)], sums[np.uintp(LANES + lane)] = n0, m0
        sums[np.uintp(2 * LANES + lane)], sums[np.uintp(3 * LANES + lane)] = n1, m1
