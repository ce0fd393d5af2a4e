"""What goes to a browser: one kind byte, a head in JSON, and bytes that the page unpacks with what every browser has.

    offset size
    0      1     kind
    1      1     version of this form
    2      2     length of the head, little endian
    4      n     head, JSON
    4+n    ..    a zlib stream (disparity, reasons) or a JPEG file (pictures)

Disparity is the wire's own: sixteenths of a pixel, 0 where unmatched. Each row is taken as differences from the pixel before,
folded so that small ones are small numbers, all low bytes first and then all high ones: half the bytes of plain zlib.
"""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable, Mapping
from enum import IntEnum

import msgspec
import numpy as np
from numpy.typing import NDArray

__all__ = ["FORM", "Kind", "LazyMessage", "pack", "packed_plane", "packed_steps"]

FORM = 1
_HEAD_MOST = 0xFFFF
_QUICK = 1  # zlib level


class Kind(IntEnum):
    """What a message holds; of each kind the newest wins."""

    DISPARITY = 1
    LEFT = 2  # the rectified left picture, as the camera sent it
    RAW = 3  # the sensor's frame, both views in it
    PAIR = 4  # both rectified views, side by side, made here of a raw frame
    REASONS = 5  # why pixels are unmatched, every so many both ways


class LazyMessage:
    """A message that is made when the first browser has room for it, once for all of them, in the thread that asks."""

    def __init__(self, make: Callable[[], bytes]) -> None:
        self._make: Callable[[], bytes] | None = make
        self._lock = threading.Lock()
        self._data = b""

    def data(self) -> bytes:
        """Give the bytes; empty where they could not be made."""
        with self._lock:
            if self._make is not None:
                make, self._make = self._make, None
                self._data = make()
            return self._data


def pack(kind: Kind, head: Mapping[str, object], body: bytes) -> bytes:
    """Make the bytes of a message."""
    told = msgspec.json.encode(head)
    assert len(told) <= _HEAD_MOST
    return bytes([kind, FORM]) + len(told).to_bytes(2, "little") + told + body


def packed_steps(steps: NDArray[np.uint16]) -> bytes:
    """Pack disparities (height, width) uint16."""
    change = np.empty_like(steps)
    change[:, 0] = steps[:, 0]
    np.subtract(steps[:, 1:], steps[:, :-1], out=change[:, 1:])  # modulo 2^16, as the page adds them up again
    signed = change.view(np.int16)
    folded = ((signed << 1) ^ (signed >> 15)).view(np.uint16)
    return zlib.compress((folded & 0xFF).astype(np.uint8).tobytes() + (folded >> 8).astype(np.uint8).tobytes(), _QUICK)


def packed_plane(plane: NDArray[np.uint8]) -> bytes:
    """Pack a plane (height, width) uint8."""
    return zlib.compress(np.ascontiguousarray(plane).tobytes(), _QUICK)
