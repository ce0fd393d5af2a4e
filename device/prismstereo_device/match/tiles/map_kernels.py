"""What is done to a finished map: the symmetric mean, and how it leaves as pixels, confidence and reasons."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_any
from prismstereo_device.match.tiles.lanes import BYTES, PIECES, SHORTS, TILE, WORDS, Code, Memory, Value, kernel
from prismstereo_device.reasons import Reason

__all__ = ["mark_flat", "smooth", "unpack"]

Bytes = NDArray[np.uint8]
Shorts = NDArray[np.int16]
Longs = NDArray[np.int64]
Floats = NDArray[np.float32]

_REACH = 2  # pixels of the mean to each side
_WITHIN = 16  # sixteenths: what is farther belongs to something else
_PER_PIXEL = np.float32(1 / 16)
_MATCHED, _WEAK = int(Reason.MATCHED), -int(Reason.WEAK_TEXTURE)


@kernel(arrays=2, numbers=2)
def _mean(code: Code, disparity: Memory, smoothed: Memory, at: Value, stride: Value) -> None:
    """Mean of 5x5 pixels that lie within a pixel of the middle, in pairs that lie opposite: a slanted plane keeps its slope."""
    for piece in PIECES:
        here = (at + piece) * 2
        middle = disparity.load(here, SHORTS)
        matched = middle.below(0).same(0)
        lowest = (middle.below(_WITHIN)).choose(code.constant(SHORTS, 0), middle - _WITHIN)
        span = middle + _WITHIN - lowest
        sums, number = middle - lowest, code.constant(SHORTS, 1)
        for y in range(_REACH + 1):
            for x in range(-_REACH, _REACH + 1):
                if y == 0 and x <= 0:
                    continue
                away = (stride * y + x) * 2
                one, other = disparity.load(here + away, SHORTS), disparity.load(here - away, SHORTS)
                pair = ((one - lowest) <= span) & ((other - lowest) <= span)
                sums = sums + pair.choose((one - lowest) + (other - lowest), 0)
                number = number + pair.choose(code.constant(SHORTS, 2), 0)
        mean = (
            sums.widened(WORDS).floats().over(number.widened(WORDS).floats()).plus(0.5).whole().narrowed(SHORTS)
            + lowest
        )
        smoothed.store(here, matched.choose(mean, middle))


@compiled_any
def smooth(disparity: Shorts, smoothed: Shorts, margins: Longs, width: int, begin: int, end: int) -> None:
    """Write the symmetric mean of the rows begin .. end; margins of 2 rows and 2 columns at least are there."""
    stride = disparity.shape[1]
    for y in range(begin, end):
        for x in range(0, width, TILE):
            _mean(disparity, smoothed, (y + margins[0]) * stride + margins[1] + x, stride)


@kernel(arrays=5, numbers=4)
def _unpack(
    code: Code, steps: Memory, margin: Memory, pixels: Memory, confidence: Memory, reasons: Memory, at_map: Value,
    at_margin: Value, at: Value, first: Value,
) -> None:  # fmt: skip
    """Unpack 32 pixels; `first` is added to the disparity."""
    for piece in PIECES:
        value = steps.load((at_map + piece) * 2, SHORTS)
        lost = value.below(0)
        whole = value.widened_signed(WORDS) + first.everywhere(WORDS) * _WITHIN
        found = whole.floats(signed=True).times(1 / _WITHIN)
        pixels.store((at + piece) * 4, lost.choose(found.filled(math.nan), found))
        confidence.store(at + piece, lost.choose(code.constant(BYTES, 0), margin.load(at_margin + piece)))
        reason = lost.choose(code.constant(SHORTS, 0) - value, code.constant(SHORTS, _MATCHED))
        reasons.store(at + piece, reason.narrowed(BYTES))


@compiled_any
def unpack(
    steps: Shorts,
    margins: Longs,
    margin: Bytes,
    first: int,
    pixels: Floats,
    confidence: Bytes,
    reasons: Bytes,
    begin: int,
    end: int,
) -> None:
    """Write disparity (NaN where unmatched), confidence (0 there) and reasons of the rows begin .. end."""
    width = pixels.shape[1]
    for y in range(begin, end):
        for x in range(0, width - TILE + 1, TILE):
            at_map = (y + margins[0]) * steps.shape[1] + margins[1] + x
            _unpack(steps, margin, pixels, confidence, reasons, at_map, y * margin.shape[1] + x, y * width + x, first)
        for x in range(width - width % TILE, width):
            value = np.float32(steps[y + margins[0], x + margins[1]])
            lost = value < 0
            pixels[y, x] = np.float32(np.nan) if lost else (np.float32(first * _WITHIN) + value) * _PER_PIXEL
            confidence[y, x] = np.uint8(0) if lost else margin[y, x]
            reasons[y, x] = np.uint8(-value) if lost else np.uint8(_MATCHED)


@kernel(arrays=1, numbers=1, returns=True)
def _changes(code: Code, padded: Memory, at: Value) -> Value:
    """Tell, a bit each, at which of 32 pixels the row goes up or down."""
    found = code.constant(BYTES, 0)
    for piece in PIECES:
        found = found | (padded.load(at + (piece + 1)) ^ padded.load(at + (piece - 1)))
    return (found > 0).packed_mask()


@compiled_any
def mark_flat(padded: Bytes, disparity: Shorts, margins: Longs, edge: int, height: int, begin: int, end: int) -> None:
    """Unmatch the tiles, in the tile rows begin .. end, that show nothing: no change along any of their rows.

    Smaller plain areas keep what the paths bring to them from their surroundings. `padded`: the left picture with `edge`
    pixels around it.
    """
    stride = padded.shape[1]
    for row in range(begin * TILE, min(end * TILE, height), TILE):
        for x in range(0, stride - 2 * edge, TILE):
            last = min(row + TILE, height)
            y = row
            while y < last and _changes(padded, (y + edge) * stride + x + edge) == 0:
                y += 1
            if y == last:
                for y in range(row, last):
                    for column in range(x + margins[1], x + margins[1] + TILE):
                        disparity[y + margins[0], column] = _WEAK
