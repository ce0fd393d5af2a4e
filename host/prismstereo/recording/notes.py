"""What a recording says beside the packets: what happened, how the camera's clock ran, and with whom each session was."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, TypeVar

import google_crc32c
import msgspec

from prismstereo.clock import ClockMapping
from prismstereo.recording.container import TopicKind

__all__ = [
    "CLOCKS",
    "CLOCK_TOPIC",
    "EVENTS",
    "EVENT_TOPIC",
    "ClockNote",
    "EventNote",
    "SessionNote",
    "described",
    "read_note",
    "undescribed",
]

Note = TypeVar("Note", bound=msgspec.Struct)
Clock = Annotated[int, msgspec.Meta(ge=0, le=1 << 62)]
Offset = Annotated[float, msgspec.Meta(ge=-1e18, le=1e18)]
Name = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{16}\Z")]
Skew = Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]

EVENT_TOPIC = "/prismstereo/events"
CLOCK_TOPIC = "/prismstereo/clock"
_CHECK = "crc32c"
_MOST_BYTES = 64 << 10


class EventNote(msgspec.Struct, frozen=True):
    """Something that happened: a session that began, a silence, a reboot, packets that the recorder had no room for.

    `host_us` is the host's monotonic clock, `session` counts from 1, `count` are the packets that were dropped.
    """

    kind: str
    session: int
    host_us: Clock
    text: str = ""
    count: Clock = 0


class ClockNote(msgspec.Struct, frozen=True):
    """The camera's clock as the host saw it from `host_us` (monotonic) on; `wall_ns` is the wall clock of that moment."""

    offset_us: Offset
    skew_ppm: Skew
    bound_us: Offset
    at_device_us: Clock
    host_us: Clock
    wall_ns: Clock

    @property
    def mapping(self) -> ClockMapping:
        """The mapping of device stamps to the host's monotonic clock."""
        return ClockMapping(self.offset_us, self.skew_ppm, self.bound_us, self.at_device_us)

    def device_us(self, host_us: int) -> int:
        """Take the host's clock to the device's."""
        skew = self.skew_ppm * 1e-6
        return self.at_device_us + round((host_us - self.at_device_us - self.offset_us) / (1.0 + skew))


class SessionNote(msgspec.Struct, frozen=True):
    """Who the camera was in one session; names are hexadecimal."""

    session: Annotated[int, msgspec.Meta(ge=1, le=0xFFFF_FFFF)]
    device_id: Name
    boot_id: Annotated[int, msgspec.Meta(ge=0, le=0xFFFF_FFFF)]
    calibration_hash: Name
    capabilities: Annotated[int, msgspec.Meta(ge=0, le=0xFFFF_FFFF)]
    version: int
    host_us: Clock


def _json_kind(what: type[msgspec.Struct]) -> TopicKind:
    _, parts = msgspec.json.schema_components([what])
    return TopicKind("json", f"prismstereo.{what.__name__}", "jsonschema", msgspec.json.encode(parts[what.__name__]))


EVENTS = _json_kind(EventNote)
CLOCKS = _json_kind(ClockNote)


def described(note: Mapping[str, object]) -> dict[str, str]:
    """Give named values as texts with a check sum over them, for MCAP's metadata, which has none."""
    texts = {
        key: value if isinstance(value, str) else msgspec.json.encode(value).decode() for key, value in note.items()
    }
    return {**texts, _CHECK: _sum(texts)}


def undescribed(texts: Mapping[str, str]) -> dict[str, str] | None:
    """Give the texts back without their check sum; None where it says that they are not what was written."""
    plain = {key: value for key, value in texts.items() if key != _CHECK}
    return plain if texts.get(_CHECK) == _sum(plain) else None


def _sum(texts: Mapping[str, str]) -> str:
    return f"{google_crc32c.value(msgspec.json.encode(sorted(texts.items()))):08x}"


def read_note(data: bytes, what: type[Note]) -> Note | None:
    """Read a JSON note; None where it is none."""
    if len(data) > _MOST_BYTES:
        return None
    try:
        return msgspec.json.decode(data, type=what)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
