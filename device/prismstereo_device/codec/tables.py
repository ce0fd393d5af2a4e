"""Coding tables of codec 2: how often each symbol is expected in each context, frozen for all time or made for one map.

A table is sent as a level for each symbol, four levels to an octave; level 0 is *hardly ever*. A context keeps the frozen table
where its own would cost more bits than it saves. device/CODEC.md is the specification.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.codec.bits import BitReader, BitWriter, golomb_bits
from prismstereo_device.codec.coder_kernels import SCALE_BITS
from prismstereo_device.codec.frozen import SHAPES
from prismstereo_device.codec.kernels import CONTEXTS, ESCAPE, SYMBOLS
from prismstereo_device.wire import WireError

__all__ = ["BOUNDS", "Tables"]

BOUNDS = (0, 1, 2, 4)  # largest error of a matched pixel, in sixteenths

_SCALE = 1 << SCALE_BITS
_TOP = 47
_WEIGHTS = np.array([0] + [(4 + (level & 3)) << (level >> 2) for level in range(1, _TOP + 1)], np.int64)
_BETWEEN = (_WEIGHTS[1:] + _WEIGHTS[:-1] + 1) // 2  # from here on a weight is nearer to the higher level
_PRICE_OF_BIT = 256
_PRICE = np.rint(_PRICE_OF_BIT * (SCALE_BITS - np.log2(np.maximum(np.arange(_SCALE + 1), 1)))).astype(np.int64)
_LEVEL_BITS = 6
_EVERY_SYMBOL = np.tile(np.arange(SYMBOLS, dtype=np.uint8), CONTEXTS)

Levels = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Tables:
    """What both ends of a stripe must share.

    `entries` (28 * 64,) uint32 holds frequency | start << 16 of each code, `symbols` (28 * 4096,) uint8 the symbol of each
    slot; `data` says how they differ from the frozen tables; it is empty where they do not.
    """

    entries: NDArray[np.uint32]
    symbols: NDArray[np.uint8]
    data: bytes

    @classmethod
    def frozen(cls, bound: int) -> Tables:
        """Give the tables that every end knows, for a bound of 0, 1, 2 or 4 sixteenths."""
        return _frozen(bound)

    @classmethod
    def read(cls, data: bytes, bound: int) -> Tables:
        """Read what the sender's tables have of their own; raises WireError where that is no set of tables."""
        if not data:
            return _frozen(bound)
        reader, rows = BitReader(data), _frozen_frequencies(bound).copy()
        for context in range(CONTEXTS):
            if reader.take(1):
                rows[context] = _frequencies(_read_levels(reader)[None])[0]
        reader.finish()
        return _tables(rows, bytes(data))

    @classmethod
    def fitted(cls, histogram: NDArray[np.int64], bound: int) -> Tables:
        """Make the cheapest tables for codes that occur `histogram` (28 * 64,) times."""
        counts, frozen = histogram.reshape(CONTEXTS, SYMBOLS), _frozen_frequencies(bound)
        levels = _nearest_levels(counts)
        own = _frequencies(levels)
        saved = (counts * (_PRICE[frozen] - _PRICE[own])).sum(axis=1)
        pays = saved > _PRICE_OF_BIT * _bits(levels)
        if not pays.any():
            return _frozen(bound)
        writer = BitWriter()
        for row, chosen in zip(levels, pays.tolist(), strict=True):
            writer.put(int(chosen), 1)
            if chosen:
                _write_levels(writer, row)
        return _tables(np.where(pays[:, None], own, frozen), writer.finish())


def _tables(rows: NDArray[np.int64], data: bytes) -> Tables:
    """Lay out frequencies (28, 64) as the loops need them."""
    starts = np.cumsum(rows, axis=1) - rows
    return Tables((rows | starts << 16).astype(np.uint32).ravel(), np.repeat(_EVERY_SYMBOL, rows.ravel()), data)


def _frequencies(levels: Levels) -> NDArray[np.int64]:
    """Turn levels (n, 64) into frequencies (n, 64) of 1 or more that add up to 4096; the highest level takes the rest."""
    weights = _WEIGHTS[levels]
    totals = np.maximum(weights.sum(axis=1, keepdims=True), 1)
    shares: NDArray[np.int64] = 1 + weights * (_SCALE - SYMBOLS) // totals
    shares[np.arange(len(levels)), np.argmax(weights, axis=1)] += _SCALE - shares.sum(axis=1)
    return shares


def _nearest_levels(counts: NDArray[np.int64]) -> Levels:
    """Give the levels (n, 64) that stand for counts (n, 64); the largest count of a row gets the highest level."""
    largest = np.maximum(counts.max(axis=1, keepdims=True), 1)
    levels: Levels = np.searchsorted(_BETWEEN, counts * _WEIGHTS[_TOP] // largest, side="right")
    return levels


def _used(levels: Levels) -> NDArray[np.int64]:
    """Give the last symbol of an error that has a level, for each row of levels (n, 64); 0 where none has."""
    errors = levels[:, 1:ESCAPE] > 0
    return np.where(errors.any(axis=1), ESCAPE - 1 - np.argmax(errors[:, ::-1], axis=1), 0)


def _folded_steps(levels: Levels) -> NDArray[np.int64]:
    """Give each error's step (n, 62) from the mean of the two levels before it, folded: 0, -1, 1, ... become 0, 1, 2, ..."""
    before = np.full((len(levels), ESCAPE + 1), _TOP)  # two more than there are errors
    before[:, 2:] = levels[:, 1:ESCAPE]
    steps = before[:, 2:] - (before[:, 1:-1] + before[:, :-2]) // 2
    folded: NDArray[np.int64] = np.where(steps >= 0, 2 * steps, -2 * steps - 1)
    return folded


def _bits(levels: Levels) -> NDArray[np.int64]:
    """Count the bits that `_write_levels` needs for each row of levels (n, 64)."""
    each = golomb_bits(_folded_steps(levels))
    each[np.arange(ESCAPE - 1) >= _used(levels)[:, None]] = 0
    total: NDArray[np.int64] = 3 * _LEVEL_BITS + each.sum(axis=1)
    return total


def _write_levels(writer: BitWriter, levels: Levels) -> None:
    """Write levels (64,): of unmatched and of escape, the last error in use, and then each error's step."""
    last = int(_used(levels[None])[0])
    for number in (int(levels[0]), int(levels[ESCAPE]), last):
        writer.put(number, _LEVEL_BITS)
    for step in _folded_steps(levels[None])[0, :last].tolist():
        writer.put_golomb(step)


def _read_levels(reader: BitReader) -> Levels:
    """Read what `_write_levels` wrote; raises WireError."""
    levels = np.zeros(SYMBOLS, np.int64)
    unmatched, escape, last = (reader.take(_LEVEL_BITS) for _ in range(3))
    if max(unmatched, escape) > _TOP or last >= ESCAPE:
        raise WireError(
            f"tables with levels {unmatched} and {escape} up to symbol {last}: at most {_TOP} and {ESCAPE - 1}"
        )
    one, two = _TOP, _TOP
    for symbol in range(1, last + 1):
        folded = reader.take_golomb()
        level = (one + two) // 2 + (-(folded + 1) // 2 if folded & 1 else folded // 2)
        if not 0 <= level <= _TOP:
            raise WireError(f"tables with level {level} of symbol {symbol}: 0 to {_TOP} are possible")
        levels[symbol] = level
        one, two = level, one
    levels[0], levels[ESCAPE] = unmatched, escape
    return levels


@cache
def _frozen(bound: int) -> Tables:
    return _tables(_frozen_frequencies(bound), b"")


@cache
def _frozen_frequencies(bound: int) -> NDArray[np.int64]:
    """Give the frozen frequencies (28, 64) of a bound."""
    unmatched, none, first, halves, escape = np.array(SHAPES[bound]).T[:, :, None]
    distance = np.arange(SYMBOLS) // 2
    levels = np.maximum(first - (distance - 1) * halves // 2, 0)
    levels[:, 0], levels[:, 1], levels[:, ESCAPE] = unmatched[:, 0], none[:, 0], escape[:, 0]
    rows = _frequencies(levels)
    rows.setflags(write=False)
    return rows
