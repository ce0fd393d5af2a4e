"""What the device tells about itself once a second."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntFlag
from typing import ClassVar, Self

from prismstereo_device.protocol.body import read_fields

__all__ = ["Health", "HealthFlag"]

_TEMPERATURE_UNKNOWN = 0x7FFF
_COUNTER = 0xFFFF_FFFF
_KNOWN_FLAGS = 3  # what a later version may add is ignored


class HealthFlag(IntFlag):
    """States of the stream."""

    NONE = 0
    END_OF_STREAM = 1  # the source has no more frames, and the last one is on the line before this message
    SOURCE_FAILED = 2  # ... because it broke


@dataclass(frozen=True, slots=True)
class Health:
    """Counters since the device started (modulo 2^32): its frames, and the packets it received from the host."""

    frames_captured: int
    frames_sent: int
    frames_dropped: int
    packets_good: int
    packets_bad: int
    packets_oversize: int
    uptime_us: int
    temperature_c: float | None = None  # to a tenth
    flags: HealthFlag = HealthFlag.NONE

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IIIIIIQhB")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        counters = (
            self.frames_captured,
            self.frames_sent,
            self.frames_dropped,
            self.packets_good,
            self.packets_bad,
            self.packets_oversize,
        )
        tenths = _TEMPERATURE_UNKNOWN
        if self.temperature_c is not None:
            tenths = max(-_TEMPERATURE_UNKNOWN, min(_TEMPERATURE_UNKNOWN - 1, round(self.temperature_c * 10)))
        wrapped = (counter & _COUNTER for counter in counters)
        return self._LAYOUT.pack(*wrapped, self.uptime_us, tenths, self.flags)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a report, whatever its flags; raises WireError."""
        fields = read_fields(cls._LAYOUT, body, "a health report")
        captured, sent, dropped, good, bad, oversize, uptime_us, tenths, flags = fields
        temperature_c = None if tenths == _TEMPERATURE_UNKNOWN else tenths / 10
        known = HealthFlag(flags & _KNOWN_FLAGS)
        return cls(captured, sent, dropped, good, bad, oversize, uptime_us, temperature_c, known)
