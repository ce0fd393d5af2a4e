"""Disparity codec 2: compiled, exact or within a bound, in independent stripes.

Each pixel is predicted from its neighbours and its error becomes one of 64 symbols; *unmatched* is one of them, so that the
mask is always exact. 28 contexts tell how likely each symbol is, and a range coder (static rANS) spends the bits. The state
that the reader ends with holds a check of all pixels of the stripe. device/CODEC.md is the specification, with test vectors.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.codec.baseline import rows_per_stripe
from prismstereo_device.codec.kernels import CONTEXTS, HEAD, SYMBOLS, model_map, plain_check, read_stripe, write_map
from prismstereo_device.codec.tables import BOUNDS, Tables
from prismstereo_device.wire import LIMITS, WireError
from prismstereo_hw.errors import UsageError

__all__ = ["BOUNDS", "CODEC", "EncodedMap", "Tables", "decode_stripe", "encode_stripes", "rows_per_stripe", "warm_up"]

CODEC = 2  # this codec's number on the wire


@dataclass(frozen=True, slots=True)
class EncodedMap:
    """A map as bytes: each stripe's, top to bottom, and what all of them need of `tables` (empty: the frozen ones)."""

    tables: bytes
    stripes: tuple[bytes, ...]

    @property
    def size(self) -> int:
        """Bytes altogether."""
        return len(self.tables) + sum(map(len, self.stripes))


def encode_stripes(steps: NDArray[np.uint16], bound: int, tables: Tables | None = None) -> EncodedMap:
    """Compress sixteenths (height, width) uint16, 0 = unmatched; no matched pixel moves by more than `bound` sixteenths.

    `bound` is 0 (exact), 1, 2 or 4. Without `tables` the map gets its own where they pay. Stripes have `rows_per_stripe(width)`
    rows. Raises UsageError for another bound, WireError where the map is empty or larger than a frame may be.
    """
    _check_bound(bound)
    if steps.ndim != 2 or 0 in steps.shape or max(steps.shape) > LIMITS.frame_side:
        raise WireError(f"a map of {steps.shape}: 1 to {LIMITS.frame_side} rows and columns can be sent")
    steps = np.ascontiguousarray(steps, dtype=np.uint16)
    height, width = steps.shape
    rows = rows_per_stripe(width)
    number = -(-height // rows)
    codes, escapes = np.empty(steps.size, np.uint16), np.empty(steps.size, np.uint16)
    counts, checks = np.zeros(number, np.int64), np.empty(number, np.uint32)
    histogram = np.zeros(CONTEXTS * SYMBOLS, np.int64)
    model_map(steps, bound, rows, codes, escapes, counts, checks, histogram)
    tables = Tables.fitted(histogram, bound) if tables is None else tables
    words = np.empty(2 * number + steps.size + 2 * int(counts.sum()), np.uint16)
    begins = np.empty(number + 1, np.int64)
    write_map(codes, rows * width, escapes, counts, checks, tables.entries, words, begins)
    places = begins.tolist()
    stripes = (
        _shorter(words[begin:end], steps[index * rows : (index + 1) * rows])
        for index, (begin, end) in enumerate(pairwise(places))
    )
    return EncodedMap(tables.data, tuple(stripes))


def _shorter(words: NDArray[np.uint16], pixels: NDArray[np.uint16]) -> bytes:
    """Give a stripe's words, or the pixels themselves where they are fewer: noise grows by no more than four bytes."""
    if words.nbytes <= HEAD + pixels.nbytes:
        return words.astype("<u2", copy=False).tobytes()
    return struct.pack("<I", plain_check(pixels.ravel())) + pixels.astype("<u2", copy=False).tobytes()


def decode_stripe(data: bytes, rows: int, width: int, bound: int, tables: Tables) -> NDArray[np.uint16]:
    """Restore one stripe, (rows, width) uint16 sixteenths, 0 = unmatched; raises WireError on anything else.

    `bound` and `tables` are those that the map was compressed with. Bytes that were changed on the way are refused but for one
    case in millions: every bit that is read and the sum over all pixels have to lead to the one state that ends a stripe.
    """
    _check_bound(bound)
    pixels = rows * width
    if rows < 1 or width < 1 or pixels > LIMITS.stripe_pixels:
        raise WireError(f"a stripe of {rows} x {width} pixels: 1 to {LIMITS.stripe_pixels} pixels are allowed")
    if len(data) < HEAD or len(data) % 2 or len(data) > HEAD + 2 * pixels:
        raise WireError(f"a stripe of {len(data)} bytes: an even number from {HEAD} to {HEAD + 2 * pixels} is due")
    words = np.frombuffer(data, "<u2").astype(np.uint16, copy=False)
    if words[1] == 0:
        plain = words[HEAD // 2 :]
        if plain.size != pixels or plain_check(plain) != words[0]:
            raise WireError(f"a stripe of {len(data)} bytes whose plain pixels fail their check")
        return plain.reshape(rows, width).copy()
    out = np.empty((rows, width), np.uint16)
    if not read_stripe(words, bound, tables.entries, tables.symbols, out):
        raise WireError(f"a stripe of {len(data)} bytes that does not end in its check")
    return out


def warm_up() -> None:
    """Compile the loops, or read them from the cache, before the first frame waits for them."""
    noise = np.arange(64, dtype=np.uint16).reshape(8, 8) * np.uint16(1021)
    for steps in (noise, noise // 999):
        encoded = encode_stripes(steps, 1)
        decode_stripe(encoded.stripes[0], 8, 8, 1, Tables.read(encoded.tables, 1))


def _check_bound(bound: int) -> None:
    if bound not in BOUNDS:
        raise UsageError(f"a bound of {bound} sixteenths: it is one of {BOUNDS}")
