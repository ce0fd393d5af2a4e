"""Semi-global matching over label lists, written plainly: the oracle of the compiled sweeps."""

from __future__ import annotations

import numpy as np

from prismstereo_device.match.tiles.census_kernels import EDGE, OFFSETS
from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.level import Penalties

__all__ = ["census", "costs", "decided", "path_sums"]

NEVER = 10_000
LARGEST = 255


def census(picture: np.ndarray) -> np.ndarray:
    """31 comparisons of every pixel's surroundings, (height, width, 31) bool; the border goes on outside."""
    wide = np.pad(picture, EDGE, mode="edge")
    height, width = picture.shape

    def moved(y: int, x: int) -> np.ndarray:
        return wide[EDGE + y : EDGE + y + height, EDGE + x : EDGE + x + width]

    return np.stack([moved(-y, -x) > moved(y, x) for y, x in OFFSETS], axis=2)


def costs(left: np.ndarray, right: np.ndarray, labels: int) -> np.ndarray:
    """Comparisons that differ, (height, width, labels); left of the right picture none is true."""
    own, other = census(left), census(right)
    found = []
    for label in range(labels):
        there = np.zeros_like(other)
        there[:, label:] = other[:, : other.shape[1] - label]
        found.append((own ^ there).sum(axis=2))
    return np.stack(found, axis=2)


def allowed(lists: list[list[int]], height: int, width: int, labels: int) -> np.ndarray:
    """Where a pixel's tile has a label, (height, width, labels)."""
    across = -(-width // TILE)
    has = np.zeros((height, width, labels), bool)
    for tile, names in enumerate(lists):
        y, x = tile // across * TILE, tile % across * TILE
        has[y : y + TILE, x : x + TILE, names] = True
    return has


def _path(cost: np.ndarray, has: np.ndarray, grey: np.ndarray, prices: Penalties) -> np.ndarray:
    """Sums along axis 0, (length, lanes, labels)."""
    sums = np.full(cost.shape, NEVER)
    sums[0] = np.where(has[0], cost[0], NEVER)
    for step in range(1, len(cost)):
        before = np.pad(sums[step - 1], ((0, 0), (1, 1)), constant_values=NEVER)
        lowest = before.min(axis=1, keepdims=True)
        rise = np.abs(grey[step].astype(int) - grey[step - 1])
        jump = np.maximum(prices.jump - rise, prices.jump_at_edge)[:, None]
        stay = np.minimum(before[:, 1:-1], np.minimum(before[:, :-2], before[:, 2:]) + prices.step)
        best = np.minimum(stay, lowest + jump) - lowest
        sums[step] = np.where(has[step], best + cost[step], NEVER)
    return sums


def path_sums(cost: np.ndarray, has: np.ndarray, grey: np.ndarray, prices: Penalties) -> np.ndarray:
    """All four paths together, at most 255, (height, width, labels)."""
    total = np.zeros(cost.shape, int)
    for swap in (False, True):
        given = [array.swapaxes(0, 1) if swap else array for array in (cost, has, grey)]
        both = _path(*given, prices) + _path(*(array[::-1] for array in given), prices)[::-1]
        total += both.swapaxes(0, 1) if swap else both
    return np.where(has, np.minimum(total, LARGEST), LARGEST)


def decided(sums: np.ndarray, has: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The best label of each pixel, and the lead on the best of those that are not beside it (none: 255)."""
    winner = sums.argmin(axis=2)
    labels = np.arange(sums.shape[2])
    far = has & (np.abs(labels - winner[..., None]) > 1)
    second = np.where(far, sums, LARGEST).min(axis=2)
    return winner, second - sums.min(axis=2)
