"""Where a replay stands: the next packet, when it is due, and which of its neighbours belong before it."""

from __future__ import annotations

import time
from collections.abc import Iterator

from prismstereo.recording.chunk import Damage
from prismstereo.recording.notes import ClockNote
from prismstereo.recording.recording import Entry, Recording
from prismstereo.recording.stored_packet import StoredPacket

__all__ = ["Playhead"]

_LONGEST_GAP_S = 2.0  # where the camera was away for an hour, nobody has to wait for it
_LATE_S = 0.25


class Playhead:
    """Walks through a recording at `pace` times its own pace, or (None) as fast as it is asked; for one thread at a time."""

    def __init__(self, recording: Recording, pace: float | None, start_s: float = 0.0) -> None:
        self._recording = recording
        self._pace = pace
        self.damage = Damage()
        self.clock: ClockNote | None = None
        self._entries: Iterator[tuple[int, Entry]] = iter(())
        self._next: StoredPacket | None = None
        self._at_ns = recording.start_ns
        self._anchor: tuple[float, int] | None = None  # host's clock in seconds, recorded clock in microseconds
        self._last_us: int | None = None
        self.move(start_s)

    @property
    def position_s(self) -> float:
        """How far into the recording the next packet lies."""
        return max(0, self._at_ns - self._recording.start_ns) * 1e-9

    @property
    def next(self) -> StoredPacket | None:
        """The packet that comes next; None at the end."""
        return self._next

    def move(self, position_s: float) -> None:
        """Go to so many seconds from the beginning."""
        from_ns = self._recording.start_ns + round(position_s * 1e9)
        self._entries = self._recording.entries(self.damage, from_ns=from_ns)
        self.clock = self._anchor = self._last_us = None
        self.advance()
        while self._next is not None and self._at_ns < from_ns:
            self.advance()

    def advance(self) -> None:
        """Go to the next packet; what is noted before it holds from now on."""
        for time_ns, entry in self._entries:
            if isinstance(entry, ClockNote):
                self.clock = entry
            elif isinstance(entry, StoredPacket):
                self._at_ns, self._next = time_ns, entry
                return
        self._next = None

    def halt(self) -> None:
        """Let the time stand still; it goes on with the next question."""
        self._anchor = None

    def due_in_s(self) -> float:
        """Give how long the next packet has to wait; 0: none of it."""
        if self._pace is None or self._next is None:
            return 0.0
        now_s, host_us = time.monotonic(), self._next.host_us
        jumped = self._last_us is not None and not 0 <= host_us - self._last_us <= _LONGEST_GAP_S * 1e6
        self._last_us = host_us
        if self._anchor is None or jumped:
            self._anchor = (now_s, host_us)
        due_s = self._anchor[0] + (host_us - self._anchor[1]) * 1e-6 / self._pace
        if now_s - due_s > _LATE_S:
            self._anchor = (now_s, host_us)  # the reader was slow: go on from here
        return max(0.0, due_s - now_s)

    def recorded_us(self) -> int | None:
        """Give the recorded host's clock as it would be now; None where replay and recording differ in pace."""
        if self._pace != 1.0 or self._anchor is None:
            return None
        return self._anchor[1] + round((time.monotonic() - self._anchor[0]) * 1e6)
