"""Compiled loops of codec 2: pixels to codes, codes to bytes, and bytes back to pixels. device/CODEC.md is the specification.

Pixels are uint16 sixteenths, 0 where unmatched. A code is 64 * context + symbol. A coding table (28 * 64,) uint32 holds
frequency | start << 16 of each code, and the frequencies of a context add up to 4096. Whatever the bytes of a stripe are, every
index that they lead to is masked or compared before it is used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.codec.coder_kernels import (
    HALF,
    LOW,
    SCALE_BITS,
    SLOT,
    WORD,
    pull,
    pull_escaped,
    push,
    push_escaped,
)
from prismstereo_device.compiled import compiled, inlined

__all__ = [
    "CONTEXTS",
    "ESCAPE",
    "HEAD",
    "SCALE_BITS",
    "SYMBOLS",
    "model_map",
    "plain_check",
    "read_stripe",
    "write_map",
]

SYMBOLS = 64
CONTEXTS = 28  # 12 by how rough the neighbourhood is, 16 by which of the four neighbours are matched
ESCAPE = 63  # the pixel itself follows, in two bytes
HEAD = 4  # bytes of a stripe before its words

_LARGEST = 65535
_ROUGHEST = 11
_ALL_MATCHED = 15
_BITS = np.array([number.bit_length() for number in range(1 << (_ROUGHEST - 1))] + [_ROUGHEST], np.int64)
_LIFT = 1 << 15  # steps that make every error positive
_MIX = np.uint32(0x9E3779B1)

Map = NDArray[np.uint16]
Bytes = NDArray[np.uint8]
Words = NDArray[np.uint32]
Counts = NDArray[np.int64]


@inlined
def _rows_of(lines: NDArray[np.int32], y: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Give the row above and the row to fill, of two (width + 2,): 2 * value + 1 where matched; the row above gets its ends."""
    above, here = lines[1 - (y & 1)], lines[y & 1]
    above[0] = above[1]
    above[above.size - 1] = above[above.size - 2]
    return above, here


@inlined
def _context(a: int, b: int, c: int, d: int, pattern: int) -> int:
    """Tell a pixel's context from its neighbours: left, above, above left, above right."""
    if pattern != _ALL_MATCHED:
        return _ROUGHEST + 1 + pattern
    return int(_BITS[min(abs(a - c) + abs(b - c) + abs(b - d), 1 << (_ROUGHEST - 1))])


@inlined
def _guess(a: int, b: int, c: int, d: int, pattern: int, calm: int) -> int:
    """Predict a pixel: by a mean where its neighbours differ by `calm` at most, else by the median of a, b and a + b - c."""
    low, high = min(a, b), max(a, b)
    median = min(max(a + b - c, low), high)
    if pattern != _ALL_MATCHED:
        both = pattern & 3
        if both == 0:
            return d if pattern & 8 else (c if pattern & 4 else a)
        return median if both == 3 else (a if both == 1 else b)
    if calm < 0:
        return median
    mean = (5 * a + 3 * b + 2 * d - 2 * c + 4) >> 3
    calm_here = -int(abs(a - c) + abs(b - c) + abs(b - d) <= calm)  # all bits or none: no branch to be guessed wrong
    return median ^ ((median ^ mean) & calm_here)


@inlined
def _calm(bound: int) -> int:
    """Give the roughness up to which a mean predicts better than a median; -1 (never) where nothing is rounded."""
    return 2 * (2 * bound + 1) if bound > 0 else -1


@inlined
def _symbol(pixel: int, guess: int, bound: int) -> int:
    """Fold the rounded error of a guess to 1 (none), 2 (-1 step), 3 (+1 step), ...; ESCAPE where that is too far."""
    error = pixel - guess
    if bound > 0:
        step = 2 * bound + 1
        inverse = (1 << 24) // step + 1  # exact up to 2^24 / step, which no error reaches
        error = ((error + bound + step * _LIFT) * inverse >> 24) - _LIFT
    return min((error << 1 ^ error >> 63) + 1, ESCAPE)


@inlined
def _restored(symbol: int, guess: int, bound: int) -> int:
    """Give the pixel that a symbol between 1 and 62 stands for."""
    turn = (symbol & 1) - 1
    error = (symbol >> 1 ^ turn) - turn
    return min(max(guess + error * (2 * bound + 1), 1), _LARGEST)


@compiled
def model_map(
    steps: Map, bound: int, rows: int, codes: Map, escapes: Map, counts: Counts, checks: Words, histogram: Counts
) -> None:
    """Turn a map (height, width) into codes (height * width,), in stripes of `rows` rows that know nothing of one another.

    Stripe i has counts[i] escaped pixels, one stripe's after the other's in `escapes` (height * width,), and checks[i], the
    check of its restored pixels. `histogram` (28 * 64,) counts the codes of the whole map; it and `counts` come in as zeros.
    """
    height, width = steps.shape
    lines = np.zeros((2, width + 2), np.int32)
    calm, escaped, at = _calm(bound), 0, 0
    for y in range(height):
        stripe = y // rows
        if y % rows == 0:
            lines[:] = 0
            checks[stripe] = 0
        above, here = _rows_of(lines, y)
        middle, before = above[1], above[0]
        a, left, check = middle >> 1, middle & 1, checks[stripe]
        for x in range(1, width + 1):
            after = above[x + 1]
            b, c, d = middle >> 1, before >> 1, after >> 1
            pattern = left | (middle & 1) << 1 | (before & 1) << 2 | (after & 1) << 3
            before, middle = middle, after
            code = _context(a, b, c, d, pattern) * SYMBOLS
            pixel = int(steps[y, x - 1])
            left = np.int32(0)
            if pixel != 0:
                left = np.int32(1)
                guess = _guess(a, b, c, d, pattern, calm)
                symbol = _symbol(pixel, guess, bound)
                code += symbol
                a = np.int32(pixel)
                if symbol == ESCAPE:
                    escapes[escaped] = pixel
                    escaped += 1
                    counts[stripe] += 1
                elif bound > 0:
                    a = np.int32(_restored(symbol, guess, bound))
                check = np.uint32((check ^ np.uint32(a)) * _MIX)
            else:
                check = np.uint32(check * _MIX)
            codes[at] = code
            at += 1
            histogram[code] += 1
            here[x] = a << 1 | left
        checks[stripe] = check
    for stripe in range(checks.size):
        checks[stripe] = checks[stripe] >> HALF


@compiled
def write_map(
    codes: Map, pixels: int, escapes: Map, counts: Counts, checks: Words, table: Words, words: Map, begins: Counts
) -> None:
    """Write all stripes of `pixels` pixels to the end of `words`; stripe i is words[begins[i] : begins[i + 1]].

    Each is written from its end to its beginning. `words` (w,) needs two words per stripe, one per code and two per escape.
    """
    at, escaped = words.size, counts.sum()
    begins[counts.size] = at
    for stripe in range(counts.size - 1, -1, -1):
        state = np.uint32(LOW + checks[stripe])
        for index in range(min((stripe + 1) * pixels, codes.size) - 1, stripe * pixels - 1, -1):
            code = codes[index]
            if code & ESCAPE == ESCAPE:
                escaped -= 1
                state, at = push_escaped(state, int(escapes[escaped]), words, at)
            entry = table[code]
            state, at = push(state, entry & WORD, entry >> HALF, words, at)
        at -= 2
        words[at + 1] = state >> HALF
        words[at] = state & WORD
        begins[stripe] = at


@compiled
def read_stripe(words: Map, bound: int, table: Words, symbols: Bytes, out: Map) -> bool:
    """Restore a stripe to `out` (rows, width), or tell that the words are none: `out` then holds anything.

    `symbols` (28 * 4096,) tells the symbol of each slot of each context.
    """
    height, width = out.shape
    if words.size < 2 or words[1] == 0:
        return False
    lines = np.zeros((2, width + 2), np.int32)
    state = np.uint32(words[0] | words[1] << HALF)
    calm, at, check = _calm(bound), 2, np.uint32(0)
    for y in range(height):
        above, here = _rows_of(lines, y)
        middle, before = above[1], above[0]
        a, left = middle >> 1, middle & 1
        for x in range(1, width + 1):
            after = above[x + 1]
            b, c, d = middle >> 1, before >> 1, after >> 1
            pattern = left | (middle & 1) << 1 | (before & 1) << 2 | (after & 1) << 3
            before, middle = middle, after
            context = _context(a, b, c, d, pattern)
            symbol = symbols[context << SCALE_BITS | np.int64(state & SLOT)]
            entry = table[context * SYMBOLS + symbol]
            state, at = pull(state, entry & WORD, entry >> HALF, words, at)
            left = np.int32(symbol != 0)
            if symbol == ESCAPE:
                escaped, state, at = pull_escaped(state, words, at)
                a = np.int32(escaped)
                if a == 0:
                    return False
            elif left:
                a = np.int32(_restored(symbol, _guess(a, b, c, d, pattern, calm), bound))
            pixel = a if left else np.int32(0)
            check = np.uint32((check ^ np.uint32(pixel)) * _MIX)
            out[y, x - 1] = pixel
            here[x] = a << 1 | left
    return bool(at == words.size and state == LOW + (check >> HALF))


@compiled
def plain_check(pixels: Map) -> np.uint32:
    """Give the check of the pixels (n,) of a stripe, 0..65535."""
    check = np.uint32(0)
    for index in range(pixels.size):
        check = np.uint32((check ^ np.uint32(pixels[index])) * _MIX)
    return np.uint32(check >> HALF)
