"""What the device tells about itself once a second."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntFlag
from typing import ClassVar, Self

from prismstereo_device.protocol.body import cut_text, read_fields, read_grown

__all__ = ["Health", "HealthFlag"]

_TEMPERATURE_UNKNOWN = 0x7FFF
_COUNTER = 0xFFFF_FFFF
_KNOWN_FLAGS = 3  # what a later version may add is ignored
_HALVED = 4  # the flag of frames at half resolution
_NO_BOUND = 0xFF  # codec 1 is in use, which is exact
_ERROR_BYTES = 64


class HealthFlag(IntFlag):
    """States of the stream."""

    NONE = 0
    END_OF_STREAM = 1  # the source has no more frames, and the last one is on the line before this message
    SOURCE_FAILED = 2  # ... because it broke


@dataclass(frozen=True, slots=True)
class Health:
    """Counters since the device started (modulo 2^32): its frames, and the packets it received from the host.

    `bound` is the largest error of a pixel, in sixteenths, of the frames that are being sent (None: codec 1);
    `line_bytes_per_s` what lately went out, in all; `last_error` at most 64 bytes of UTF-8, empty where all is well.
    """

    frames_captured: int
    frames_sent: int
    frames_dropped: int
    packets_good: int
    packets_bad: int
    packets_oversize: int
    uptime_us: int
    temperature_c: float | None = None  # to a tenth
    flags: HealthFlag = HealthFlag.NONE
    bound: int | None = None
    half_resolution: bool = False
    pictures_dropped: int = 0
    line_bytes_per_s: int = 0
    last_error: str = ""

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IIIIIIQhB")
    _GROWN: ClassVar[struct.Struct] = struct.Struct("<BIIB")

    def pack(self) -> bytes:
        """Give the body's bytes; counters are taken modulo 2^32, the rate and the text are cut to what they may have."""
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
        flags = self.flags | (_HALVED if self.half_resolution else 0)
        error = cut_text(self.last_error, _ERROR_BYTES)
        grown = self._GROWN.pack(
            _NO_BOUND if self.bound is None else self.bound,
            self.pictures_dropped & _COUNTER,
            min(self.line_bytes_per_s, _COUNTER),
            len(error),
        )
        return self._LAYOUT.pack(*wrapped, self.uptime_us, tenths, flags) + grown + error

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a report, whatever its flags and however old its sender; raises WireError."""
        fields = read_fields(cls._LAYOUT, body, "a health report")
        captured, sent, dropped, good, bad, oversize, uptime_us, tenths, flags = fields
        temperature_c = None if tenths == _TEMPERATURE_UNKNOWN else tenths / 10
        known = HealthFlag(flags & _KNOWN_FLAGS)
        grown = read_grown(cls._GROWN, body, cls._LAYOUT.size) or (_NO_BOUND, 0, 0, 0)
        bound, pictures_dropped, line_bytes_per_s, length = grown
        text = body[cls._LAYOUT.size + cls._GROWN.size :][: min(length, _ERROR_BYTES)]
        return cls(
            captured,
            sent,
            dropped,
            good,
            bad,
            oversize,
            uptime_us,
            temperature_c,
            known,
            None if bound == _NO_BOUND else bound,
            bool(flags & _HALVED),
            pictures_dropped,
            line_bytes_per_s,
            text.decode(errors="ignore"),
        )
