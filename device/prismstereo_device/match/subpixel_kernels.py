"""Compiled loops of the sub-pixel stage: one step of gradient least squares, and the symmetric mean.

Disparities are int16 sixteenths of a pixel, negative where unmatched; pictures and maps are given row after row, as one array
(height * width,). Rows are worked on in stripes of `_STRIPE` columns, whose sums stay in the nearest cache. All sums are
float32 in a fixed order and nothing is fused or regrouped: neither threads nor the width of vectors change a bit.

Windows follow the surface: a row's sums take in the pixels whose disparity is within a pixel of the one in its middle, and a
window takes in the rows whose middle is within a pixel of its own. Two surfaces at a depth edge never mix. Each row's mean
is taken off before rows are added, so that a view that is darker, or unevenly lit, moves nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled

__all__ = ["LEAST_WIDTH", "level_rows", "refine_rows"]

LEAST_WIDTH = 8  # a narrower picture has hardly a pixel with neighbours in both views

_REACH = 3  # the window is 7x7
_LEVEL_REACH = 2  # the mean is over 5x5
_STRIPE = 128
_BATCH = 16  # rows of sums that are made before they are used
_WIDE = _STRIPE + 16  # a stripe, and what its windows see on either side
_ROW = 3 * _WIDE  # floats of one row of sums: disparity, power of the slopes, and their pull
_POWER, _PULL = _WIDE, 2 * _WIDE
_SLOPE, _GAP = _WIDE, 2 * _WIDE  # of one row of pixels, behind the disparity
_SEEN_BEFORE = 2 * _REACH  # rows that the next batch needs again
_PIXEL = np.float32(1)
_ZERO = np.float32(0)
_SIXTH = np.float32(1 / 6)
_STEP = np.float32(1 / 16)
_TWELFTH = np.float32(1 / 12)
_NOWHERE = np.float32(-1e6)  # the disparity of what is unknown: within a pixel of no other
_STIFFNESS = np.float32(10.0)  # squared grey levels per window: next to no texture moves next to nothing
_FARTHEST = np.float32(0.5)  # a whole-pixel start is off by no more; what moves on follows something else

Grey = NDArray[np.uint8]
Steps = NDArray[np.int16]
Floats = NDArray[np.float32]
Words = NDArray[np.int32]


def _four_bytes(typing_context: Any, pixels: Any, at: Any) -> Any:
    """Read four neighbours at once, the first in the lowest byte: little-endian processors only, as numpy's wheels are."""
    del typing_context

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        word = context.get_value_type(types.int32)
        place = builder.bitcast(builder.gep(array.data, [arguments[1]]), word.as_pointer())
        read = builder.load(place)
        read.align = 1
        return read

    return types.int32(pixels, at), generate


_word_at: Any = intrinsic(_four_bytes)


@compiled
def _look(right: Grey, steps: Steps, start: int, first: int, last: int, width: int, words: Words) -> None:
    """Fetch the four right pixels around the partner of each pixel of a row that begins at `start`, columns first to last."""
    for x in range(first, last):
        column = np.int32(x - ((np.int32(steps[np.uintp(start + x)]) + 15) >> 4) - 1)
        words[np.uintp(x - first)] = min(max(column, np.int32(0)), np.int32(width - 4))
    for i in range(last - first):
        words[np.uintp(i)] = _word_at(right, np.uintp(start + words[np.uintp(i)]))


@compiled
def _compare(
    left: Grey, steps: Steps, start: int, first: int, last: int, width: int, words: Words, line: Floats
) -> None:
    """Write disparity, slope and gap (right minus left) of a row's pixels; nowhere where one of them is not known.

    The slope is the left picture's alone: the right one's noise is in the gap as well, and would lean to whole pixels.
    """
    for x in range(first, last):
        at = np.uintp(start + x)
        step = np.int32(steps[at])
        column = np.int32(x - ((step + 15) >> 4))
        word = words[np.uintp(x - first)]
        a, b = np.float32(np.int32(word & 255)), np.float32(np.int32((word >> 8) & 255))
        c, d = np.float32(np.int32((word >> 16) & 255)), np.float32(np.int32((word >> 24) & 255))
        part = np.float32(np.int32(-step & 15)) * _STEP
        # the cubic through four pixels moves detail less than smoother ones do; all but the sixth is exact in a float
        cubic = part * (d - a + np.float32(3) * (b - c))
        square = part * (np.float32(3) * (a + c) - np.float32(6) * b + cubic)
        seen = b + _SIXTH * part * (np.float32(6) * c - np.float32(2) * a - np.float32(3) * b - d + square)
        inside = (step >= 0) & (column >= 1) & (column < width - 2)
        grey = left[at]
        near = np.int32(left[at + np.uintp(1)]) - np.int32(left[at - np.uintp(1)])
        far = np.int32(left[at + np.uintp(2)]) - np.int32(left[at - np.uintp(2)])
        out = np.uintp(x - first)
        line[out] = np.float32(step) * _STEP if inside else _NOWHERE
        line[out + np.uintp(_SLOPE)] = np.float32(np.int32(8 * near - far)) * _TWELFTH
        line[out + np.uintp(_GAP)] = seen - np.float32(grey)


@compiled
def _sum_row(line: Floats, held: Floats, base: int, count: int) -> None:
    """Sum a row's pixels over the seven columns around each of `count` pixels, where the disparity is within a pixel."""
    for x in range(count):
        own = line[np.uintp(x + _REACH)]
        many = slopes = gaps = powers = pulls = _ZERO
        for i in range(2 * _REACH + 1):
            at = np.uintp(x + i)
            other = line[at] - own
            same = abs(other) <= _PIXEL
            # read first and choose then: a read that may not happen keeps SSE and NEON from working on four at once
            slope = line[at + np.uintp(_SLOPE)]
            gap = line[at + np.uintp(_GAP)] + slope * other
            slope = slope if same else _ZERO
            gap = gap if same else _ZERO
            many += _PIXEL if same else _ZERO
            slopes += slope
            gaps += gap
            powers += slope * slope
            pulls += slope * gap
        mean = slopes / max(many, _PIXEL)
        out = np.uintp(base + x)
        held[out] = own
        held[out + np.uintp(_POWER)] = powers - mean * slopes
        held[out + np.uintp(_PULL)] = pulls - mean * gaps


@compiled
def _solve_row(held: Floats, base: int, count: int, steps: Steps, refined: Steps, at: int) -> None:
    """Write the one disparity that explains the window best; `held` has the seven rows of sums around this one."""
    for x in range(count):
        own = held[np.uintp(base + _REACH * _ROW + x)]
        powers = pulls = _ZERO
        for j in range(2 * _REACH + 1):
            row = np.uintp(base + j * _ROW + x)
            other = held[row] - own
            same = abs(other) <= _PIXEL
            power = held[row + np.uintp(_POWER)]
            pull = held[row + np.uintp(_PULL)] + power * other
            powers += power if same else _ZERO
            pulls += pull if same else _ZERO
        move = min(max(pulls / (powers + _STIFFNESS), -_FARTHEST), _FARTHEST)
        step = np.int32(steps[np.uintp(at + x)])
        moved = max(np.int32(np.int32(move * np.float32(16) + np.float32(64.5)) - 64 + step), np.int32(0))
        refined[np.uintp(at + x)] = np.int16(moved if own >= _ZERO else step)


@compiled
def _hold_row(
    left: Grey, right: Grey, steps: Steps, shape: tuple[int, int], row: int, x0: int, count: int,
    words: Words, line: Floats, held: Floats, base: int,
) -> None:  # fmt: skip
    """Make the sums of one row of a stripe of `count` columns from x0; a row beyond the picture matches nothing."""
    height, width = shape
    if row < 0 or row >= height:
        held[base : base + _ROW] = _ZERO
        held[base : base + count] = _NOWHERE
        return
    first, last = max(x0 - _REACH, 2), min(x0 + count + _REACH, width - 2)
    line[:_WIDE] = _NOWHERE
    skip = first - (x0 - _REACH)
    _look(right, steps, row * width, first, last, width, words)
    _compare(left, steps, row * width, first, last, width, words, line[skip:])
    _sum_row(line, held, base, count)


@compiled
def refine_rows(
    left: Grey, right: Grey, steps: Steps, refined: Steps, shape: tuple[int, int], top: int, bottom: int
) -> None:
    """Write rows top to bottom of `refined`: one step of least squares, at most half a pixel, nothing below zero.

    The width is at least `LEAST_WIDTH`. What is unmatched, and what has no neighbours on either side in both views, stays as
    it is.
    """
    width = shape[1]
    words = np.zeros(_WIDE, np.int32)
    line = np.zeros(3 * _WIDE, np.float32)
    held = np.zeros((_BATCH + _SEEN_BEFORE) * _ROW, np.float32)
    for x0 in range(0, width, _STRIPE):
        count = min(_STRIPE, width - x0)
        for row in range(_SEEN_BEFORE):
            _hold_row(left, right, steps, shape, top - _REACH + row, x0, count, words, line, held, row * _ROW)
        for begin in range(top, bottom, _BATCH):
            many = min(_BATCH, bottom - begin)
            for row in range(many):
                base = (row + _SEEN_BEFORE) * _ROW
                _hold_row(left, right, steps, shape, begin + row + _REACH, x0, count, words, line, held, base)
            for row in range(many):
                _solve_row(held, row * _ROW, count, steps, refined, (begin + row) * width + x0)
            held[: _SEEN_BEFORE * _ROW] = held[many * _ROW : (many + _SEEN_BEFORE) * _ROW].copy()


@compiled
def _gather_pairs(steps: Steps, start: int, width: int, totals: Steps, pairs: Steps) -> None:
    """Add up, for each pixel of a row, by how much its neighbours differ from it, in pairs that lie opposite each other."""
    for x in range(_LEVEL_REACH, width - _LEVEL_REACH):
        at = np.uintp(start + x)
        own = steps[at]
        total, number = np.int16(0), np.int16(0)
        for j in range(_LEVEL_REACH + 1):
            for i in range(-_LEVEL_REACH, _LEVEL_REACH + 1):
                if j > 0 or i > 0:
                    away = np.uintp(j * width + i)
                    one, two = np.int16(steps[at + away] - own), np.int16(steps[at - away] - own)
                    # both within a pixel: unsigned, what is below -16 is far above 32
                    both = (np.uint16(one + 16) <= np.uint16(32)) & (np.uint16(two + 16) <= np.uint16(32))
                    total = np.int16(total + (np.int16(one + two) if both else np.int16(0)))
                    number = np.int16(number + (np.int16(1) if both else np.int16(0)))
        totals[np.uintp(x)] = total
        pairs[np.uintp(x)] = number


@compiled
def _level_row(steps: Steps, start: int, width: int, totals: Steps, pairs: Steps, levelled: Steps) -> None:
    for x in range(_LEVEL_REACH, width - _LEVEL_REACH):
        at = np.uintp(start + x)
        own = steps[at]
        mean = np.float32(np.int32(totals[np.uintp(x)])) / np.float32(np.int32(2 * pairs[np.uintp(x)] + 1))
        moved = np.int16(max(own + np.int32(mean + np.float32(32.5)) - 32, 0))
        levelled[at] = moved if own >= 0 else own


@compiled
def level_rows(steps: Steps, levelled: Steps, shape: tuple[int, int], top: int, bottom: int) -> None:
    """Write rows top to bottom of `levelled`: means of those of 5x5 pixels that are within a pixel of the middle one.

    They are taken in pairs that lie opposite each other, both or neither: a slanted surface keeps its slope. A border of two
    pixels and what is unmatched stay as they are.
    """
    height, width = shape
    totals, pairs = np.zeros(width, np.int16), np.zeros(width, np.int16)
    levelled[top * width : bottom * width] = steps[top * width : bottom * width]
    for y in range(max(top, _LEVEL_REACH), min(bottom, height - _LEVEL_REACH)):
        _gather_pairs(steps, y * width, width, totals, pairs)
        _level_row(steps, y * width, width, totals, pairs, levelled)
