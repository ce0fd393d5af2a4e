"""Compiled steps of codec 2's range coder (static rANS): one symbol, or one escaped pixel, in and out of a 32-bit state.

Words are 16 bits; frequencies add up to 4096. A stripe is written from its end to its beginning and read from its beginning.
device/CODEC.md is the specification.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import inlined

__all__ = ["HALF", "LOW", "SCALE_BITS", "SLOT", "WORD", "pull", "pull_escaped", "push", "push_escaped"]

SCALE_BITS = 12

LOW = np.uint32(1 << 16)  # a state is at least this between two symbols
SLOT = np.uint32((1 << SCALE_BITS) - 1)
_SCALE = np.uint32(SCALE_BITS)
WORD = np.uint32(0xFFFF)
HALF = np.uint32(16)  # bits of a word
_LOW_BYTE = np.uint32(16)  # slots of each low byte of an escaped pixel
# Slots of each high byte: near disparities are rare, and those beyond 256 pixels very rare. Up to 8, up to 16, the others.
_NEAR, _NEARER = 8, 16
_FAR_SLOTS, _NEAR_SLOTS, _NEARER_SLOTS = 384, 64, 2
_NEAR_START = _NEAR * _FAR_SLOTS
_NEARER_START = _NEAR_START + (_NEARER - _NEAR) * _NEAR_SLOTS
_HIGH_END = _NEARER_START + (256 - _NEARER) * _NEARER_SLOTS  # the slots from here on mean nothing

Map = NDArray[np.uint16]


@inlined
def push(state: np.uint32, frequency: np.uint32, start: np.uint32, words: Map, at: int) -> tuple[np.uint32, int]:
    """Write one symbol in front of what is written; return the new state and the place of the foremost word."""
    if state >= frequency << np.uint32(32 - SCALE_BITS):
        at -= 1
        words[at] = state & WORD
        state = np.uint32(state >> HALF)
    quotient = np.uint32(state // frequency)
    return np.uint32((quotient << _SCALE) + (state - quotient * frequency) + start), at


@inlined
def _high_byte_slots(byte: int) -> tuple[int, int]:
    """Give frequency and start of the high byte of an escaped pixel."""
    if byte < _NEAR:
        return _FAR_SLOTS, byte * _FAR_SLOTS
    if byte < _NEARER:
        return _NEAR_SLOTS, _NEAR_START + (byte - _NEAR) * _NEAR_SLOTS
    return _NEARER_SLOTS, _NEARER_START + (byte - _NEARER) * _NEARER_SLOTS


@inlined
def _high_byte(slot: int) -> int:
    """Give the high byte that a slot below `_HIGH_END` stands for."""
    if slot < _NEAR_START:
        return slot // _FAR_SLOTS
    if slot < _NEARER_START:
        return _NEAR + (slot - _NEAR_START) // _NEAR_SLOTS
    return _NEARER + (slot - _NEARER_START) // _NEARER_SLOTS


@inlined
def push_escaped(state: np.uint32, pixel: int, words: Map, at: int) -> tuple[np.uint32, int]:
    """Write an escaped pixel: the low byte first, so that a reader meets the high one first."""
    frequency, start = _high_byte_slots(pixel >> 8)
    state, at = push(state, _LOW_BYTE, np.uint32((pixel & 255) * _LOW_BYTE), words, at)
    return push(state, np.uint32(frequency), np.uint32(start), words, at)


@inlined
def _refill(state: np.uint32, words: Map, at: int) -> tuple[np.uint32, int]:
    """Take in the next word where the state is low; beyond the last word the place still counts on, which is an error later."""
    if state < LOW:
        state = np.uint32(state << HALF)
        if at < words.size:
            state = np.uint32(state | words[at])
        at += 1
    return state, at


@inlined
def pull(state: np.uint32, frequency: np.uint32, start: np.uint32, words: Map, at: int) -> tuple[np.uint32, int]:
    """Undo one `push`: return the state before it and the place of the next word."""
    state = np.uint32(frequency * (state >> _SCALE) + (state & SLOT) - start)
    return _refill(state, words, at)


@inlined
def pull_escaped(state: np.uint32, words: Map, at: int) -> tuple[int, np.uint32, int]:
    """Take an escaped pixel: its value (0 where it is none), the state after it and the place of the next word."""
    slot = int(state & SLOT)
    if slot >= _HIGH_END:
        return 0, state, at
    high = _high_byte(slot)
    frequency, start = _high_byte_slots(high)
    state, at = pull(state, np.uint32(frequency), np.uint32(start), words, at)
    low = int((state & SLOT) // _LOW_BYTE)
    state, at = pull(state, _LOW_BYTE, np.uint32(low * _LOW_BYTE), words, at)
    return high << 8 | low, state, at
