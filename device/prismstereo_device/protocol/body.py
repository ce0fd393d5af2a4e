"""How a message's body is read: fixed fields first, anything after them is a later version's and is ignored."""

from __future__ import annotations

import struct
from typing import Any

from prismstereo_device.wire import WireError

__all__ = ["read_fields"]


def read_fields(layout: struct.Struct, body: bytes, what: str) -> tuple[Any, ...]:
    """Unpack the fields at the start of `body`; raises WireError, naming `what`, where it is too short."""
    if len(body) < layout.size:
        raise WireError(f"{what} of {len(body)} bytes: it has at least {layout.size}")
    return layout.unpack_from(body)
