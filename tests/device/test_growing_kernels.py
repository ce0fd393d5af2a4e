"""Growing Correspondence Seeds: the compiled loops do just what the definitions say, which are written plainly here."""

from __future__ import annotations

import math
from collections import defaultdict
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device.shifted_noise import grey, noise, shifted
from prismstereo_device.match.growing.growing_kernels import MARGIN_PX, NEVER, ONE, grow, matched_along_rows
from prismstereo_device.match.growing.selection_kernels import listed, selected
from prismstereo_device.match.growing.settings import PRESETS, GrowingSettings
from prismstereo_device.match.growing.windows import PaddedPair

Hypothesis = tuple[int, int, int]  # row, column, disparity


# ---- the definitions, written plainly


def plain_correlation(left: np.ndarray, right: np.ndarray, at: Hypothesis, half: int, noise_grey: float) -> int:
    """2 cov / (var + var + the noise's), in units of 1 / ONE, of windows in pictures mirrored at their borders."""
    y, x, d = at
    a, b = (
        np.pad(picture.astype(np.int64), half, "reflect")[y : y + 2 * half + 1, column : column + 2 * half + 1].ravel()
        for picture, column in ((left, x), (right, x - d))
    )
    n = a.size
    covariance = n * (a @ b) - a.sum() * b.sum()
    powers = n * (a @ a) - a.sum() ** 2 + n * (b @ b) - b.sum() ** 2
    return round(float(np.rint(2 * ONE * covariance / (powers + 2 * n * n * noise_grey**2))))


def neighbourhoods(at: Hypothesis) -> list[list[Hypothesis]]:
    """The four of the paper, written with both columns: left, right, the row above, the row below."""
    y, x, d = at
    other = x - d
    columns = [
        [(y, x - 1, other - 1), (y, x - 2, other - 1), (y, x - 1, other - 2)],
        [(y, x + 1, other + 1), (y, x + 2, other + 1), (y, x + 1, other + 2)],
    ] + [
        [(row, x, other), (row, x + 1, other), (row, x - 1, other), (row, x, other + 1), (row, x, other - 1)]
        for row in (y - 1, y + 1)
    ]
    return [[(row, a, a - b) for row, a, b in near] for near in columns]


def plain_growth(
    left: np.ndarray, right: np.ndarray, seeds: list[Hypothesis], first: int, labels: int, growing: GrowingSettings
) -> dict[Hypothesis, int]:
    """Grow by the book: the best bucket first (64 / ONE wide), in it the last come, over dictionaries."""
    height, width = left.shape
    accepted: dict[Hypothesis, int] = {}
    best_left, best_right = defaultdict(lambda: -math.inf), defaultdict(lambda: -math.inf)
    buckets: dict[int, list[Hypothesis]] = defaultdict(list)

    @cache
    def correlation(at: Hypothesis) -> float:
        y, x, d = at
        if not (0 <= y < height and 0 <= x < width and 0 <= x - d < width and first <= d < labels):
            return -math.inf
        return plain_correlation(left, right, at, 2, growing.noise_grey)

    for seed in seeds:
        buckets[int(correlation(seed) + ONE) // 64].append(seed)
    while any(buckets.values()):
        popped = buckets[max(number for number, waiting in buckets.items() if waiting)].pop()
        for near in neighbourhoods(popped):
            values = [correlation(at) for at in near]
            c = max(values)
            t = near[values.index(c)]
            y, x, d = t
            link = min(best_left[y, x], best_right[y, x - d])
            crowd = sum((y, x, other) in accepted for other in range(first, labels))
            if c == -math.inf or c < round(growing.tau * ONE) or c + round(growing.mu * ONE) < link:
                continue
            if growing.dgrow0:
                gap = c - max([*values[: values.index(c)], *values[values.index(c) + 1 :]])
                taken = max(best_left[y, x], best_right[y, x - d]) > -math.inf
                if taken or gap < round(growing.epsilon * ONE):
                    continue
            if t in accepted or crowd == growing.max_hypotheses:
                continue
            accepted[t] = int(c)
            best_left[y, x] = max(best_left[y, x], c)
            best_right[y, x - d] = max(best_right[y, x - d], c)
            buckets[int(c + ONE) // 64].append(t)
    return accepted


def compiled_growth(
    left: np.ndarray, right: np.ndarray, seeds: list[Hypothesis], first: int, labels: int, growing: GrowingSettings
) -> dict[Hypothesis, int]:
    pair = PaddedPair.of(left, right)
    windows = pair.windows(2, growing.noise_grey)
    places = np.array([((y + MARGIN_PX) * pair.width + x + MARGIN_PX, d) for y, x, d in seeds], np.int64)
    table, count = grow(
        pair.pictures, windows.sums, windows.powers, windows.floor, pair.width, first, labels, places,
        round(growing.tau * ONE), round(growing.mu * ONE), growing.max_hypotheses, growing.dgrow0,
        round(growing.epsilon * ONE),
    )  # fmt: skip
    accepted = {}
    for p in np.flatnonzero(count):
        for entry in table[p, : count[p]].astype(int):
            y, x = divmod(int(p), pair.width)
            accepted[y - MARGIN_PX, x - MARGIN_PX, entry & 0xFFFF] = (entry >> 16) + NEVER
    return accepted


@pytest.mark.parametrize(
    "growing",
    [
        GrowingSettings(), PRESETS["dense"], GrowingSettings(mu=0.0), GrowingSettings(tau=-1.0, mu=0.5, max_hypotheses=3),
        GrowingSettings(dgrow0=True), GrowingSettings(tau=0.2, dgrow0=True, epsilon=0.03), GrowingSettings(noise_grey=0.0),
    ],
)  # fmt: skip
def test_growing_accepts_just_the_hypotheses_that_the_definition_accepts(
    growing: GrowingSettings, rng: np.random.Generator
) -> None:
    picture = noise(rng, 12, 26)
    left, right = grey(picture + rng.normal(0, 3, picture.shape)), grey(shifted(picture, 3.4))
    seeds = [(5, 12, 3), (2, 20, 5), (5, 12, 3), (11, 25, 1)]
    expected = plain_growth(left, right, seeds, 1, 7, growing)
    assert compiled_growth(left, right, seeds, 1, 7, growing) == expected
    assert len(expected) > 20


def test_seeds_are_the_best_of_their_whole_row(rng: np.random.Generator) -> None:
    left, right = rng.integers(0, 256, (2, 14, 30), np.uint8)
    pair = PaddedPair.of(left, right)
    windows = pair.windows(3, 1.1)
    spots = [(0, 0), (3, 29), (7, 12), (13, 20)]
    places = np.array([(y + MARGIN_PX) * pair.width + x + MARGIN_PX for y, x in spots], np.int64)
    disparities, correlations = matched_along_rows(
        pair.pictures, windows.sums, windows.powers, windows.floor, pair.width, 3, 2, 11, places
    )
    assert correlations[0] == NEVER  # nothing to the left of the first column
    for (y, x), d, c in list(zip(spots, disparities, correlations, strict=True))[1:]:
        row = {other: plain_correlation(left, right, (y, x, other), 3, 1.1) for other in range(2, min(11, x + 1))}
        assert (c, row[int(d)]) == (max(row.values()), max(row.values()))


# ---- the final matching


def largest_sub_kernel(
    row: list[tuple[int, int, int]], beta: int, zonegap: int, *, ordering: bool
) -> set[tuple[int, int]]:
    """The maximum strict sub-kernel by trying every subset of (correlation, column, disparity), ranked as given."""
    every = range(len(row))

    def rivals(i: int, k: int) -> bool:
        (_, x, d), (_, column, other) = row[i], row[k]
        crossing = (x - column) * ((x - d) - (column - other)) < 0
        return i != k and (x == column or x - d == column - other or (ordering and crossing))

    def threatens(k: int, t: int) -> bool:
        same_peak = abs(row[k][2] - row[t][2]) <= zonegap
        return rivals(k, t) and (k < t or (not same_peak and row[k][0] > row[t][0] - beta))

    def bits(chosen: list[int]) -> int:
        return sum(1 << i for i in chosen)

    def beaters(k: int, t: int) -> int:
        margin = 0 if abs(row[k][2] - row[t][2]) <= zonegap else beta
        return bits([m for m in range(k) if rivals(k, m) and row[m][0] >= row[k][0] + margin])

    conflict = [bits([k for k in every if rivals(t, k)]) for t in every]
    threats = [[beaters(k, t) for k in every if threatens(k, t)] for t in every]
    kernels = [
        subset
        for subset in range(1 << len(row))
        if all(not subset & conflict[t] and all(subset & beat for beat in threats[t]) for t in every if subset >> t & 1)
    ]
    largest = max(kernels, key=int.bit_count)
    assert all(kernel | largest == largest for kernel in kernels)  # it holds every other: there is one largest
    return {row[t][1:] for t in every if largest >> t & 1}


def selected_of(
    row: list[tuple[int, int, int]], beta: int, zonegap: int, *, ordering: bool
) -> tuple[np.ndarray, np.ndarray]:
    width = 8
    table, count = np.zeros((width, 10), np.uint32), np.zeros(width, np.uint8)
    for c, x, d in row:
        table[x, count[x]] = (c - NEVER) << 16 | d
        count[x] += 1
    keys = np.sort(listed(table, count, width))
    chosen, margin, standing = (
        np.empty((1, width), np.int16),
        np.empty((1, width), np.int16),
        np.empty((1, width), np.uint8),
    )
    selected(keys, np.array([0, keys.size]), np.array([beta, zonegap, ordering], np.int32), chosen, margin, standing)
    return chosen[0], margin[0]


ROWS = st.dictionaries(
    st.sampled_from([(x, d) for x in range(6) for d in range(6) if d <= x]), st.integers(0, 6), max_size=7
)


@settings(max_examples=120, deadline=None)
@given(ROWS, st.integers(0, 3), st.integers(0, 3), st.booleans())
def test_one_pass_over_a_row_finds_the_maximum_strict_sub_kernel(
    correlations: dict[tuple[int, int], int], beta: int, zonegap: int, ordering: bool
) -> None:
    row = sorted(((c, x, d) for (x, d), c in correlations.items()), key=lambda h: (-h[0], h[1], h[2]))
    chosen, _ = selected_of(row, beta, zonegap, ordering=ordering)
    matched = {(x, int(d)) for x, d in enumerate(chosen) if d >= 0}
    assert matched == largest_sub_kernel(row, beta, zonegap, ordering=ordering)


def test_a_match_needs_its_margin_over_another_peak_but_not_over_its_own() -> None:
    near, far = [(9000, 6, 0), (8900, 6, 1)], [(9000, 6, 0), (8900, 6, 5)]
    assert selected_of(near, 500, 3, ordering=False)[0][6] == 0
    assert selected_of(far, 500, 3, ordering=False)[0][6] == -1
    chosen, margin = selected_of(far, 100, 3, ordering=False)
    assert (chosen[6], margin[6]) == (0, 100)
