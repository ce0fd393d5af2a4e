"""Compiled loops of the filters over bare arrays. Disparities are float32 pixels, NaN where unmatched.

Two disparities are of one surface where they differ by at most a tolerance, see `depth_edge.Reach`, whose four numbers the
kernels take.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled

__all__ = ["closest_of_blocks", "fill_rows", "level_rows", "mark_edges", "renew", "take", "tolerance"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Flag = NDArray[np.bool_]


@compiled
def tolerance(
    value: np.float32, most: np.float32, least: np.float32, share: np.float32, offset: np.float32
) -> np.float32:
    """Return how much another disparity of the same surface may differ; `least` for NaN."""
    wide = share * (value + offset)
    return min(most, wide) if wide > least else least


@compiled
def level_rows(
    padded: Float,
    radius: int,
    first: int,
    end: int,
    most: np.float32,
    least: np.float32,
    share: np.float32,
    offset: np.float32,
    out: Float,
) -> None:
    """Write the mean of each pixel's surface in its window to rows `first` .. `end` - 1 of `out` (height, width).

    Pixels count in pairs that lie opposite each other, and only where both are of the middle's surface, so that a slanted
    surface keeps its slope up to its rim. `padded` has `radius` NaN on every side.
    """
    width = out.shape[1]
    total = np.empty(width, np.float32)
    count = np.empty(width, np.float32)
    reach = np.empty(width, np.float32)
    for y in range(first, end):
        middle = padded[y + radius, radius : radius + width]
        for x in range(width):
            reach[x] = tolerance(middle[x], most, least, share, offset)
            total[x] = np.float32(0)
            count[x] = np.float32(1)
        for down in range(radius + 1):
            for right in range(-radius, radius + 1):
                if down == 0 and right <= 0:
                    continue
                one = padded[y + radius + down, radius + right : radius + right + width]
                other = padded[y + radius - down, radius - right : radius - right + width]
                for x in range(width):
                    ahead = one[x] - middle[x]
                    behind = other[x] - middle[x]
                    both = (abs(ahead) <= reach[x]) & (abs(behind) <= reach[x])
                    total[x] += (ahead + behind) if both else np.float32(0)
                    count[x] += np.float32(2) if both else np.float32(0)
        for x in range(width):
            out[y, x] = middle[x] + total[x] / count[x]


@compiled
def renew(
    current: Float,
    moved: Byte,
    weight: np.float32,
    most: np.float32,
    least: np.float32,
    share: np.float32,
    offset: np.float32,
    memory: Float,
    ages: Byte,
) -> None:
    """Take a new map into `memory` (height, width), which is its mean over time; `ages` counts the maps in each mean.

    `weight` is that of the new value in a settled mean; a young one is the plain mean of its maps. Where the new value is of
    another surface, or `moved` is set, the mean begins anew; where there is none, it ends.
    """
    height, width = current.shape
    for y in range(height):
        for x in range(width):
            value, mean = current[y, x], memory[y, x]
            same = abs(value - mean) <= tolerance(mean, most, least, share, offset)
            if same and moved[y, x] == 0:
                age = ages[y, x]
                memory[y, x] = mean + max(weight, np.float32(1) / np.float32(age + 1)) * (value - mean)
                ages[y, x] = min(age + 1, 254)
            else:
                memory[y, x] = value
                ages[y, x] = 1


@compiled
def closest_of_blocks(
    disparity: Float, confidence: Byte, reasons: Byte, factor: int, out: Float, out_confidence: Byte, out_reasons: Byte
) -> None:
    """Write the largest disparity of each block of `factor` x `factor` pixels, with its confidence, to the `out` arrays.

    A block with no match gets the reason that most of its pixels have, the first in number where two are as many.
    """
    height, width = disparity.shape
    for row in range(out.shape[0]):
        top, bottom = row * factor, min((row + 1) * factor, height)
        for column in range(out.shape[1]):
            first, right = column * factor, min((column + 1) * factor, width)
            best, best_y, best_x = np.float32(-np.inf), -1, -1
            for y in range(top, bottom):
                for x in range(first, right):
                    if disparity[y, x] > best:
                        best, best_y, best_x = disparity[y, x], y, x
            if best_y >= 0:
                out[row, column] = best
                out_confidence[row, column] = confidence[best_y, best_x]
                out_reasons[row, column] = reasons[best_y, best_x]
            else:
                out[row, column] = np.float32(np.nan)
                out_confidence[row, column] = 0
                out_reasons[row, column] = _commonest(reasons, top, bottom, first, right)


@compiled
def _commonest(codes: Byte, top: int, bottom: int, first: int, end: int) -> int:
    """Return the code that most pixels of a block have, the smallest where two have as many."""
    best, most = 0, 0
    for y in range(top, bottom):
        for x in range(first, end):
            code = int(codes[y, x])
            if code == best:
                continue
            count = 0
            for v in range(top, bottom):
                for u in range(first, end):
                    count += codes[v, u] == code
            if count > most or (count == most and code < best):
                best, most = code, count
    return best


@compiled
def take(taken: Flag, reason: int, disparity: Float, confidence: Byte, reasons: Byte) -> int:
    """Take the matches that are `taken` (height, width) away, for a reason, and return how many they were."""
    height, width = taken.shape
    count = 0
    for y in range(height):
        for x in range(width):
            if taken[y, x] and not np.isnan(disparity[y, x]):
                disparity[y, x] = np.float32(np.nan)
                confidence[y, x] = 0
                reasons[y, x] = reason
                count += 1
    return count


@compiled
def fill_rows(disparity: Float, closed: Flag, widest: int, out: Float, filled: Flag) -> None:
    """Write `disparity` to `out`, and in gaps of at most `widest` pixels of a row the smaller of the values at both ends.

    A gap with a pixel that is `closed`, or that reaches the picture's rim, stays one.
    """
    height, width = disparity.shape
    for y in range(height):
        last = -1
        for x in range(width):
            out[y, x] = disparity[y, x]
            if closed[y, x]:
                last = -1
            elif not np.isnan(disparity[y, x]):
                if last >= 0 and 1 < x - last <= widest + 1:
                    value = min(disparity[y, last], disparity[y, x])
                    for gap in range(last + 1, x):
                        out[y, gap] = value
                        filled[y, gap] = True
                last = x


@compiled
def mark_edges(
    disparity: Float, most: np.float32, least: np.float32, share: np.float32, offset: np.float32, edge: Byte
) -> None:
    """Set `edge` (height, width) to 1 where a matched pixel has a neighbour, right or below, that is not of its surface.

    Both are marked.
    """
    height, width = disparity.shape
    for y in range(height):
        for x in range(width):
            value = disparity[y, x]
            reach = tolerance(value, most, least, share, offset)
            if x + 1 < width and not abs(disparity[y, x + 1] - value) <= reach:
                edge[y, x] = 1
                edge[y, x + 1] = 1
            if y + 1 < height and not abs(disparity[y + 1, x] - value) <= reach:
                edge[y, x] = 1
                edge[y + 1, x] = 1
