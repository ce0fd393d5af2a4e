"""Obstacle zones on the wire: one packet for a whole grid."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from prismstereo_device.protocol.body import read_fields
from prismstereo_device.wire import LIMITS, WireError
from prismstereo_device.zones import ZoneDistances

__all__ = ["ZonesMessage"]

_FLOOR_REMOVED = 1
_FRAME = 0xFFFF_FFFF


@dataclass(frozen=True, slots=True)
class ZonesMessage:
    """The zones of one frame; its body has 15 bytes and 2 for each zone: 8 rows of 14 zones fit an MTU of 240."""

    zones: ZoneDistances

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IQBBB")

    def pack(self) -> bytes:
        """Give the body's bytes; raises WireError where the grid is empty or does not fit the largest packet."""
        nearest_mm = self.zones.nearest_mm
        if nearest_mm.ndim != 2:
            raise WireError(f"zones of shape {nearest_mm.shape}: they have rows and columns")
        rows, columns = nearest_mm.shape
        _check(rows, columns)
        flags = _FLOOR_REMOVED if self.zones.floor_removed else 0
        head = self._LAYOUT.pack(self.zones.index & _FRAME, self.zones.timestamp_us, rows, columns, flags)
        return head + nearest_mm.astype("<u2").tobytes()

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a grid; raises WireError where it is empty, too large or cut."""
        index, timestamp_us, rows, columns, flags = read_fields(cls._LAYOUT, body, "a zones message")
        _check(rows, columns)
        size = 2 * rows * columns
        data = body[cls._LAYOUT.size : cls._LAYOUT.size + size]
        if len(data) != size:
            raise WireError(f"{rows} x {columns} zones in {len(data)} bytes: {size} are due")
        nearest_mm = np.frombuffer(data, "<u2").astype(np.uint16).reshape(rows, columns)
        return cls(ZoneDistances(index, timestamp_us, nearest_mm, bool(flags & _FLOOR_REMOVED)))


def _check(rows: int, columns: int) -> None:
    most = (LIMITS.payload - ZonesMessage._LAYOUT.size) // 2
    if not (1 <= rows <= 255 and 1 <= columns <= 255 and rows * columns <= most):
        raise WireError(f"{rows} x {columns} zones: 1 to 255 each way, {most} in all")
