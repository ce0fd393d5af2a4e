"""A frame's stripes and coding tables as packets, and back.

The first fragment is the head alone. The others begin with `frame u32, first_stripe u16` and carry whole stripes, one
after the other: `len u16, n_escape u16, bytes`. A lost packet so costs its stripes and nothing else.

A stripe that does not fit one packet is cut into pieces, one a packet: bit 15 of `first_stripe` is set, and after the
same `len u16, n_escape u16` of the whole stripe come `offset u16, bytes`. Pieces follow one another in order; losing
one costs that stripe.

Coding tables that do not fit beside the head travel before the first stripe, in the same form, as the stripe 32767.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from prismstereo_device.protocol.body import read_fields
from prismstereo_device.wire import LIMITS, WireError

__all__ = ["TABLES", "Piece", "cut", "read_fragment"]

TABLES = 0x7FFF  # in the place of a stripe's number

_PREFIX = struct.Struct("<IH")
_STRIPE = struct.Struct("<HH")
_OFFSET = struct.Struct("<H")
_CUT = 0x8000
_NO_ESCAPES = 0  # neither codec counts them here


@dataclass(frozen=True, slots=True)
class Piece:
    """`data` at `offset` of a stripe of `total` bytes; a whole stripe has offset 0 and all its bytes."""

    frame: int
    stripe: int
    total: int
    offset: int
    data: bytes

    @property
    def whole(self) -> bool:
        """Whether this is all of the stripe."""
        return len(self.data) == self.total


def cut(frame: int, stripes: Sequence[bytes], mtu: int, first: int = 0) -> Iterator[bytes]:
    """Lay stripes, numbered from `first`, into payloads of at most `mtu` bytes, in order.

    Raises WireError where a stripe or the MTU is beyond the limits.
    """
    if not LIMITS.payload_min <= mtu <= LIMITS.payload:
        raise WireError(f"an MTU of {mtu}: {LIMITS.payload_min} to {LIMITS.payload} bytes are possible")
    payload = b""
    for number, stripe in enumerate(stripes, first):
        if len(stripe) > LIMITS.stripe:
            raise WireError(f"a stripe of {len(stripe)} bytes: at most {LIMITS.stripe} can be sent")
        record = _STRIPE.pack(len(stripe), _NO_ESCAPES) + stripe
        if payload and len(payload) + len(record) > mtu:
            yield payload
            payload = b""
        if _PREFIX.size + len(record) > mtu:
            yield from _pieces(frame, number, stripe, mtu)
        else:
            payload = (payload or _PREFIX.pack(frame, number)) + record
    if payload:
        yield payload


def _pieces(frame: int, number: int, stripe: bytes, mtu: int) -> Iterator[bytes]:
    prefix = _PREFIX.pack(frame, number | _CUT) + _STRIPE.pack(len(stripe), _NO_ESCAPES)
    room = mtu - len(prefix) - _OFFSET.size
    for offset in range(0, len(stripe), room):
        yield prefix + _OFFSET.pack(offset) + stripe[offset : offset + room]


def read_fragment(payload: bytes) -> list[Piece]:
    """Read a fragment that is not the head: its whole stripes, or its one piece; raises WireError."""
    frame, first = read_fields(_PREFIX, payload, "a fragment")
    if first & _CUT:
        return [_read_piece(frame, first & ~_CUT, payload)]
    found: list[Piece] = []
    position = _PREFIX.size
    while position < len(payload):
        total, _ = read_fields(_STRIPE, payload[position : position + _STRIPE.size], "a stripe's head")
        position += _STRIPE.size
        data = payload[position : position + total]
        if len(data) != total:
            raise WireError(f"a stripe of {total} bytes in a fragment that has {len(data)} left")
        found.append(Piece(frame, first + len(found), total, 0, data))
        position += total
    return found


def _read_piece(frame: int, stripe: int, payload: bytes) -> Piece:
    position = _PREFIX.size + _STRIPE.size
    total, _ = read_fields(_STRIPE, payload[_PREFIX.size : position], "a stripe's head")
    (offset,) = read_fields(_OFFSET, payload[position : position + _OFFSET.size], "a piece's offset")
    data = payload[position + _OFFSET.size :]
    if not data or offset + len(data) > total:
        raise WireError(f"a piece from {offset} to {offset + len(data)} of a stripe of {total} bytes: it lies within")
    return Piece(frame, stripe, total, offset, data)
