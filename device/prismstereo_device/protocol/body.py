"""How a message's body is read: fixed fields first, then what later versions of this format put behind them.

A body only ever grows at its end. Fields that are not there, or not whole, are those of an older sender; bytes behind the last
known field are a newer sender's and are ignored.
"""

from __future__ import annotations

import struct
from typing import Any

from prismstereo_device.wire import WireError

__all__ = ["cut_text", "read_fields", "read_grown"]


def read_fields(layout: struct.Struct, body: bytes, what: str) -> tuple[Any, ...]:
    """Unpack the fields at the start of `body`; raises WireError, naming `what`, where it is too short."""
    if len(body) < layout.size:
        raise WireError(f"{what} of {len(body)} bytes: it has at least {layout.size}")
    return layout.unpack_from(body)


def read_grown(layout: struct.Struct, body: bytes, offset: int) -> tuple[Any, ...] | None:
    """Unpack fields that were added at `offset`; None where the sender is too old to have all of them."""
    return layout.unpack_from(body, offset) if len(body) >= offset + layout.size else None


def cut_text(text: str, most: int) -> bytes:
    """Give a text as UTF-8 of at most `most` bytes, cut between two characters; what UTF-8 cannot say becomes a `?`."""
    return text.encode(errors="replace")[:most].decode(errors="ignore").encode()
