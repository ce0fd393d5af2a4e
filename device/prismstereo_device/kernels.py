"""Compiled loops over bare arrays: consistent-overhead byte stuffing (COBS) of one packet.

COBS rewrites a packet so that it holds no 0x00: the packet is cut at its zeros, and each piece is sent as one code byte
(its length plus one) and its bytes; a piece of 254 bytes with no zero after it has code 0xFF. It costs 1 byte in 254.

Compiled when this module is imported (and then cached on disk), so that no packet waits for the compiler.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_for

__all__ = ["cobs_decode", "cobs_encode"]

_FULL = 255
_READ_ONLY = types.Array(types.uint8, 1, "C", readonly=True)  # writable arrays are taken too
_SIGNATURE = types.int64(_READ_ONLY, types.uint8[::1])


@compiled_for(_SIGNATURE)
def cobs_encode(raw: NDArray[np.uint8], out: NDArray[np.uint8]) -> int:
    """Write the stuffed form of `raw` (n,) uint8 to `out` and return its length, or -1 if `out` is too small.

    `out` (m,) uint8 needs m >= n + n // 254 + 1. The closing 0x00 is not written.
    """
    size = raw.size
    if out.size < size + size // 254 + 1:
        return -1
    code_at = 0
    code = 1
    position = 1
    for index in range(size):
        if code == _FULL:  # the piece is full and something follows it
            out[code_at] = _FULL
            code_at = position
            position += 1
            code = 1
        byte = raw[index]
        if byte == 0:
            out[code_at] = code
            code_at = position
            position += 1
            code = 1
        else:
            out[position] = byte
            position += 1
            code += 1
    out[code_at] = code
    return position


@compiled_for(_SIGNATURE)
def cobs_decode(stuffed: NDArray[np.uint8], out: NDArray[np.uint8]) -> int:
    """Write the packet whose stuffed form (n,) uint8 this is to `out` and return its length.

    Returns -1 where the bytes are not COBS (a zero inside, a piece that runs past the end) or `out` has less than n.
    """
    size = stuffed.size
    if out.size < size:
        return -1
    position = 0
    index = 0
    while index < size:
        code = np.int64(stuffed[index])
        index += 1
        stop = index + code - 1
        if code == 0 or stop > size:
            return -1
        while index < stop:
            byte = stuffed[index]
            if byte == 0:
                return -1
            out[position] = byte
            position += 1
            index += 1
        if code != _FULL and index < size:
            out[position] = 0
            position += 1
    return position
