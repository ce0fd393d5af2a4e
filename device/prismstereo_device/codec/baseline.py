"""Disparity codec 1, the baseline that every endpoint has: numpy and zstd only, exact, in independent stripes.

A stripe is up to 16 rows, read like text. Each matched pixel is predicted by the matched pixel before it (1 at the
start of the stripe), so that holes cost one symbol each and not two jumps. Disparities in sixteenths are 1..65535 where
matched: the difference is taken modulo 65535, brought to -32767..32767, folded to 0 -> 0, -1 -> 1, 1 -> 2, ... and sent
plus one; symbol 0 is *unmatched*. The low bytes of all symbols, then the high bytes, make one zstd frame with its size
and check sum inside.
"""

from __future__ import annotations

import numpy as np
import zstandard
from numpy.typing import NDArray

from prismstereo_device.wire import LIMITS, WireError

__all__ = ["CODEC", "decode_stripe", "encode", "rows_per_stripe"]

CODEC = 1  # this codec's number on the wire
_ROWS = 16
_MODULUS = 65535  # matched values
_HALF = 32767
_LEVEL = 1  # higher levels bought 1-5 % for 2-5 times the time


def rows_per_stripe(width: int) -> int:
    """Give the height of a stripe of this width: 16 rows, fewer where 16 incompressible rows would not fit a stripe."""
    return max(1, min(_ROWS, LIMITS.stripe_pixels // width))


def encode(steps: NDArray[np.uint16]) -> list[bytes]:
    """Compress sixteenths (height, width) uint16, 0 = unmatched, to the bytes of each stripe, top to bottom.

    Raises WireError where the map is empty or larger than a frame may be.
    """
    if steps.ndim != 2 or 0 in steps.shape or max(steps.shape) > LIMITS.frame_side:
        raise WireError(f"a map of {steps.shape}: 1 to {LIMITS.frame_side} rows and columns can be sent")
    height, width = steps.shape
    rows = rows_per_stripe(width)
    compressor = zstandard.ZstdCompressor(level=_LEVEL, write_checksum=True, write_content_size=True)
    return [compressor.compress(_planes(_fold(steps[top : top + rows].ravel()))) for top in range(0, height, rows)]


def _fold(values: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Turn one stripe's pixels (n,) into symbols (n,)."""
    matched = values != 0
    found = values[matched].astype(np.int32)
    difference = np.diff(found, prepend=np.int32(1))
    difference -= np.multiply(difference > _HALF, _MODULUS, dtype=np.int32)
    difference += np.multiply(difference < -_HALF, _MODULUS, dtype=np.int32)
    symbols = np.zeros(values.size, np.uint16)
    symbols[matched] = ((difference << 1) ^ (difference >> 31)) + 1
    return symbols


def _unfold(symbols: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Turn one stripe's symbols (n,) into pixels (n,), whatever the symbols are."""
    matched = symbols != 0
    folded = symbols[matched].astype(np.int32) - 1
    difference = (folded >> 1) ^ -(folded & 1)
    values = np.zeros(symbols.size, np.uint16)
    # At most 32,000 differences of at most 32,767: the running sum stays within 31 bits.
    values[matched] = np.cumsum(difference, dtype=np.int32) % _MODULUS + 1
    return values


def _planes(symbols: NDArray[np.uint16]) -> bytes:
    return symbols.astype("<u2").view(np.uint8).reshape(-1, 2).T.tobytes()


def decode_stripe(data: bytes, rows: int, width: int) -> NDArray[np.uint16]:
    """Restore one stripe, (rows, width) uint16 sixteenths, 0 = unmatched; raises WireError on anything else.

    What the stripe claims to hold is compared with rows * width before a byte of it is unpacked.
    """
    pixels = rows * width
    if rows < 1 or width < 1 or pixels > LIMITS.stripe_pixels:
        raise WireError(f"a stripe of {rows} x {width} pixels: 1 to {LIMITS.stripe_pixels} pixels are allowed")
    planes = np.frombuffer(_inflate(data, 2 * pixels), np.uint8).reshape(2, pixels)
    symbols = planes[0] | (planes[1].astype(np.uint16) << 8)
    return _unfold(symbols).reshape(rows, width)


def _inflate(data: bytes, size: int) -> bytes:
    """Unpack a zstd frame of exactly `size` bytes; zstd's own limit is ignored where a frame declares its size."""
    try:
        declared = zstandard.get_frame_parameters(data)
        if declared.content_size != size or not declared.has_checksum or declared.dict_id:
            raise WireError(f"a stripe that unpacks to {declared.content_size} bytes: {size} are due")
        plain = zstandard.ZstdDecompressor().decompress(data, max_output_size=size, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise WireError(f"a stripe of {len(data)} bytes that is not zstd: {error}") from error
    if len(plain) != size:
        raise WireError(f"a stripe of {len(plain)} bytes: {size} are due")
    return plain
