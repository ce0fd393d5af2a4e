"""What stands in a recording, and in which form: packets, notes, calibrations, sessions, pictures for other tools."""

from __future__ import annotations

import time
from collections.abc import Mapping

import msgspec

from prismstereo.clock import ClockMapping
from prismstereo.recording.container import Container
from prismstereo.recording.notes import (
    CLOCK_TOPIC,
    CLOCKS,
    EVENT_TOPIC,
    EVENTS,
    ClockNote,
    EventNote,
    SessionNote,
    described,
)
from prismstereo.recording.output import Output
from prismstereo.recording.recording import CALIBRATION, IDENTITY, RECORDING, SESSION
from prismstereo.recording.stored_packet import PACKET_TOPIC, PACKETS, StoredPacket
from prismstereo.recording.views import Views, view_kinds
from prismstereo_device.protocol import calibration_hash

__all__ = ["LIBRARY", "Journal"]

LIBRARY = "prismstereo"
_JSON_TYPE, _BYTES_TYPE = "application/json", "application/octet-stream"


class Journal:
    """Writes one recording to `output`, which it owns; for one thread. Every call may raise OSError, with the file still whole.

    Messages bear the wall clock: that of the beginning, going on as the monotonic one, so that nobody's setting of the clock
    puts them out of order.
    """

    def __init__(self, output: Output, views_hz: float) -> None:
        self._wall_at_zero_ns = time.time_ns() - time.monotonic_ns()
        self._clock: ClockMapping | None = None
        self._views = Views(views_hz) if views_hz else None
        self._container = Container(output, LIBRARY)
        self._packets = self._container.topic(PACKET_TOPIC, PACKETS)
        self._events = self._container.topic(EVENT_TOPIC, EVENTS)
        self._clocks = self._container.topic(CLOCK_TOPIC, CLOCKS)
        kinds = view_kinds() if views_hz else {}
        self._view_topics = {name: self._container.topic(name, kind) for name, kind in kinds.items()}

    @property
    def size(self) -> int:
        """Bytes of the file so far."""
        return self._container.size

    def wall_ns(self, host_us: int) -> int:
        """Take the host's monotonic clock to the recording's wall clock."""
        return host_us * 1000 + self._wall_at_zero_ns

    def describe(self, texts: Mapping[str, object]) -> None:
        """Say what this recording is."""
        own = {"format": 1, "wall_minus_monotonic_ns": self._wall_at_zero_ns}
        self._container.describe(RECORDING, described({**own, **texts}))

    def identify(self, details: Mapping[str, object]) -> None:
        """Keep what the camera says of itself."""
        self._container.attach(IDENTITY, _JSON_TYPE, self._now_ns(), msgspec.json.encode(details))

    def calibrate(self, content: bytes, readable: bytes = b"") -> None:
        """Keep the flash bytes that frames are made with from now on, and their JSON for people."""
        name = f"{CALIBRATION}-{calibration_hash(content).hex()}"
        self._container.attach(f"{name}.bin", _BYTES_TYPE, self._now_ns(), content)
        if readable:
            self._container.attach(f"{name}.json", _JSON_TYPE, self._now_ns(), readable)
        if self._views is not None:
            self._views.calibrate(content)

    def write(self, thing: StoredPacket | EventNote | SessionNote) -> None:
        """Keep a packet, what happened, or with whom a session began."""
        match thing:
            case StoredPacket():
                time_ns = self.wall_ns(thing.host_us)
                self._container.add(self._packets, time_ns, thing.pack())
                self._show(thing, time_ns)
            case EventNote():
                self._container.add(self._events, self.wall_ns(thing.host_us), msgspec.json.encode(thing))
            case SessionNote():
                self._container.describe(SESSION, described(msgspec.structs.asdict(thing)))

    def sync(self, clock: ClockMapping | None) -> None:
        """Note the camera's clock where it has changed, and make everything so far safe."""
        if clock is not None and clock != self._clock:
            self._clock = clock
            now_us = time.monotonic_ns() // 1000
            fit = (clock.offset_us, clock.skew_ppm, clock.bound_us, clock.at_device_us)
            note = ClockNote(*fit, now_us, time.time_ns())
            self._container.add(self._clocks, self.wall_ns(now_us), msgspec.json.encode(note))
        self._container.sync()

    def finish(self) -> None:
        """Write the index and give the file back."""
        self._container.finish()

    def leave(self) -> None:
        """Give the file back as it is."""
        self._container.leave()

    def _show(self, stored: StoredPacket, time_ns: int) -> None:
        if self._views is None:
            return
        clock = self._clock
        for view in self._views.take(
            stored, lambda device_us: time_ns if clock is None else self.wall_ns(clock.host_time_us(device_us))
        ):
            self._container.add(self._view_topics[view.topic], time_ns, view.data)

    def _now_ns(self) -> int:
        return self.wall_ns(time.monotonic_ns() // 1000)
