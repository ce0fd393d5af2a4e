"""Compiled weighted median of disparity. Weights are integers and the median is one of the values: the same bits everywhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled
from prismstereo_device.filters.filter_kernels import tolerance

__all__ = ["MOST_SAMPLES", "median_rows"]

Float = NDArray[np.float32]
Byte = NDArray[np.uint8]
Int = NDArray[np.int32]

MOST_SAMPLES = 17 * 17


@compiled
def median_rows(
    disparity: Float,
    confidence: Byte,
    picture: Byte,
    alike: Int,
    doubtful: Byte,
    most: np.float32,
    least: np.float32,
    share: np.float32,
    offset: np.float32,
    radius: int,
    stride: int,
    first: int,
    end: int,
    out: Float,
    out_confidence: Byte,
) -> None:
    """Write the disparity and confidence of rows `first` .. `end` - 1, with wrong ones among the doubtful replaced.

    Wrong is what lies on another surface than the weighted median of its window, and that median is what replaces it, with the
    smaller of the two confidences. Arrays are (height, width). Windows have every `stride`-th pixel up to `radius`. A match
    weighs its confidence times `alike` (256,), at most 255, of the difference in grey level from the middle.
    """
    width = disparity.shape[1]
    values, weights, places = (
        np.empty(MOST_SAMPLES, np.float32),
        np.empty(MOST_SAMPLES, np.int32),
        np.empty(MOST_SAMPLES, np.int32),
    )
    for y in range(first, end):
        for x in range(width):
            value = disparity[y, x]
            out[y, x] = value
            out_confidence[y, x] = confidence[y, x]
            if doubtful[y, x] == 0 or np.isnan(value):
                continue
            count = _gather(disparity, confidence, picture, alike, y, x, radius, stride, values, weights, places)
            if _holds_median(values, weights, count, value, tolerance(value, most, least, share, offset)):
                continue
            place = places[_weighted_median(values, weights, count)]
            row, column = place // width, place % width
            out[y, x] = disparity[row, column]
            out_confidence[y, x] = min(max(confidence[row, column], 1), max(confidence[y, x], 1))


@compiled
def _gather(
    disparity: Float,
    confidence: Byte,
    picture: Byte,
    alike: Int,
    y: int,
    x: int,
    radius: int,
    stride: int,
    values: Float,
    weights: Int,
    places: Int,
) -> int:
    """Write disparity, weight and place of the matches in a window, and return how many they are."""
    height, width = disparity.shape
    grey = np.int64(picture[y, x])
    count = 0
    for row in range(y - radius, y + radius + 1, stride):
        for column in range(x - radius, x + radius + 1, stride):
            if row < 0 or row >= height or column < 0 or column >= width or np.isnan(disparity[row, column]):
                continue
            values[count] = disparity[row, column]
            sure = max(np.int64(confidence[row, column]), 1)
            weights[count] = sure * alike[abs(np.int64(picture[row, column]) - grey)]
            places[count] = row * width + column
            count += 1
    return count


@compiled
def _holds_median(values: Float, weights: Int, count: int, value: np.float32, reach: np.float32) -> bool:
    """Tell whether the weighted median lies within `reach` of `value`: neither side of that has more than half the weight."""
    below, above, whole = 0, 0, 0
    for sample in range(count):
        below += weights[sample] if values[sample] < value - reach else 0
        above += weights[sample] if values[sample] > value + reach else 0
        whole += weights[sample]
    return 2 * below <= whole and 2 * above <= whole


@compiled
def _weighted_median(values: Float, weights: Int, count: int) -> int:
    """Return which sample is the smallest value up to which at least half of the weight lies, the first where several are."""
    whole = 0
    for sample in range(count):
        whole += weights[sample]
    best = -1
    for sample in range(count):
        if best >= 0 and values[sample] >= values[best]:
            continue
        upto = 0
        for other in range(count):
            upto += weights[other] if values[other] <= values[sample] else 0
        if 2 * upto >= whole:
            best = sample
    return best
