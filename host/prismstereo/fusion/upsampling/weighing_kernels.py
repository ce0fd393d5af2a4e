"""Compiled loops that weigh all sites around a pixel: their mean (joint bilateral), or the value most of them hold (mode)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled

__all__ = ["STEPS_A_SQUARE", "weighted_means", "weighted_modes"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

STEPS_A_SQUARE = 32  # entries of the table of squared distances, per square of a site
_NOTHING = np.float32(1e-12)
_BAND = np.uint8(2)
_UNSEEN = np.uint8(8)
_LEAST_SHARE = np.float32(0.02)  # a site with less of the weight does not stand for a value


@compiled
def _weigh(
    trust: Float, site_greys: Byte, grey: int, row: int, column: int, v: np.float32, u: np.float32, radius: int,
    nearness: Float, likeness: Float, weights: Float, places: Int,
) -> int:  # fmt: skip
    """Write weight and place of the trusted sites within `radius` of the site nearest to (row + v, column + u)."""
    h, w = trust.shape
    j0, i0 = row + (1 if v >= np.float32(0.5) else 0), column + (1 if u >= np.float32(0.5) else 0)
    count = 0
    for j in range(max(j0 - radius, 0), min(j0 + radius + 1, h)):
        for i in range(max(i0 - radius, 0), min(i0 + radius + 1, w)):
            if trust[j, i] <= 0:
                continue
            dy, dx = np.float32(row - j) + v, np.float32(column - i) + u
            near = nearness[np.int64((dx * dx + dy * dy) * np.float32(STEPS_A_SQUARE))]
            weights[count] = trust[j, i] * near * likeness[abs(grey - np.int64(site_greys[j, i]))]
            places[count] = j * w + i
            count += 1
    return count


@compiled
def weighted_means(
    disparity: Float, trust: Float, site_greys: Byte, guide: Byte, columns: Int, parts: Float, rows: Int,
    row_parts: Float, radius: int, nearness: Float, likeness: Float, first: int, end: int,
    out: Float, source: Int, flags: Byte,
) -> None:  # fmt: skip
    """Write the weighted mean of the sites around each pixel of rows `first` .. `end` - 1, and the site that weighs most.

    Where all weights vanish it is the nearest trusted site of them, where there is none, NaN.
    """
    most = (2 * radius + 1) ** 2
    weights, places = np.empty(most, np.float32), np.empty(most, np.int32)
    w = disparity.shape[1]
    for y in range(first, end):
        for x in range(columns.size):
            out[y, x], source[y, x] = np.float32(np.nan), np.int32(-1)
            if flags[y, x] & _UNSEEN:
                continue
            row, column, v, u = rows[y], columns[x], row_parts[y], parts[x]
            count = _weigh(
                trust, site_greys, int(guide[y, x]), row, column, v, u, radius, nearness, likeness, weights, places
            )
            if count == 0:
                continue
            whole, total, best = np.float32(0), np.float32(0), 0
            for k in range(count):
                whole += weights[k]
                total += weights[k] * disparity[places[k] // w, places[k] % w]
                best = k if weights[k] > weights[best] else best
            if whole < _NOTHING:
                best = _nearest(places, count, w, row, column, v, u)
                out[y, x] = disparity[places[best] // w, places[best] % w]
            else:
                out[y, x] = total / whole
            source[y, x] = places[best]


@compiled
def _nearest(places: Int, count: int, w: int, row: int, column: int, v: np.float32, u: np.float32) -> int:
    best, least = 0, np.float32(np.inf)
    for k in range(count):
        dy, dx = np.float32(row - places[k] // w) + v, np.float32(column - places[k] % w) + u
        if dx * dx + dy * dy < least:
            best, least = k, dx * dx + dy * dy
    return best


@compiled
def weighted_modes(
    disparity: Float, trust: Float, site_greys: Byte, guide: Byte, columns: Int, parts: Float, rows: Int,
    row_parts: Float, radius: int, nearness: Float, likeness: Float, reach: np.float32, first: int, end: int,
    out: Float, source: Int, flags: Byte,
) -> None:  # fmt: skip
    """Write, in the band of rows `first` .. `end` - 1, the disparity that most weight lies within `reach` of."""
    most = (2 * radius + 1) ** 2
    weights, places, values = np.empty(most, np.float32), np.empty(most, np.int32), np.empty(most, np.float32)
    w = disparity.shape[1]
    for y in range(first, end):
        for x in range(columns.size):
            if not flags[y, x] & _BAND:
                continue
            out[y, x], source[y, x] = np.float32(np.nan), np.int32(-1)
            row, column, v, u = rows[y], columns[x], row_parts[y], parts[x]
            count = _weigh(
                trust, site_greys, int(guide[y, x]), row, column, v, u, radius, nearness, likeness, weights, places
            )
            if count == 0:
                continue
            for k in range(count):
                values[k] = disparity[places[k] // w, places[k] % w]
            best = _strongest(values, weights, count, reach)
            if best < 0:
                best = _nearest(places, count, w, row, column, v, u)
                out[y, x] = values[best]
            else:
                out[y, x] = _mean_near(values, weights, count, values[best], reach)
            source[y, x] = places[best]


@compiled
def _strongest(values: Float, weights: Float, count: int, reach: np.float32) -> int:
    whole, best, most = weights[:count].sum(), -1, _NOTHING
    for k in range(count):
        if weights[k] < _LEAST_SHARE * whole:
            continue
        support = np.float32(0)
        for other in range(count):
            apart = (values[other] - values[k]) / reach
            support += weights[other] * max(np.float32(1) - apart * apart, np.float32(0))
        if support > most:
            best, most = k, support
    return best


@compiled
def _mean_near(values: Float, weights: Float, count: int, middle: np.float32, reach: np.float32) -> np.float32:
    total, whole = np.float32(0), np.float32(0)
    for k in range(count):
        apart = (values[k] - middle) / reach
        weight = weights[k] * max(np.float32(1) - apart * apart, np.float32(0))
        total += weight * values[k]
        whole += weight
    return np.float32(total / whole)
