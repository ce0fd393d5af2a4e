"""Where frames wait for whoever reads them: bounded, with an end."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from threading import Condition

from prismstereo_device.protocol import ReceivedFrame
from prismstereo_device.wire import LIMITS
from prismstereo_hw.errors import DeviceError

__all__ = ["FrameCounts", "Inbox"]

_FRAME = 0xFFFF_FFFF
_HALF_RANGE = 1 << 31


@dataclass(frozen=True, slots=True)
class FrameCounts:
    """Frames that arrived, of which `partial` lack stripes; `lost`: gaps in their numbers; `not_taken`: pushed out."""

    frames: int
    partial: int
    lost: int
    not_taken: int


class Inbox:
    """At most `capacity` frames; a further one pushes the oldest out, which is counted.

    With `keep_all` none is pushed out: `room` tells the device to wait instead, and the few that were already on their
    way are kept above the capacity.
    """

    def __init__(self, capacity: int, *, keep_all: bool) -> None:
        self._capacity = capacity
        self._keep_all = keep_all
        self._frames: deque[ReceivedFrame] = deque()
        self._changed = Condition()
        self._ended = False
        self._error: DeviceError | None = None
        self._newest: int | None = None
        self._arrived = self._partial = self._lost = self._not_taken = 0

    @property
    def counts(self) -> FrameCounts:
        """The counters so far."""
        with self._changed:
            return FrameCounts(self._arrived, self._partial, self._lost, self._not_taken)

    @property
    def room(self) -> int:
        """How many frames the device may send on."""
        if not self._keep_all:
            return LIMITS.frames_unacknowledged
        return max(0, min(LIMITS.frames_unacknowledged, self._capacity - len(self._frames)))

    def put(self, frame: ReceivedFrame) -> None:
        """Add the newest frame."""
        with self._changed:
            self._count(frame)
            if len(self._frames) >= self._capacity and not self._keep_all:
                self._frames.popleft()
                self._not_taken += 1
            self._frames.append(frame)
            self._changed.notify()

    def _count(self, frame: ReceivedFrame) -> None:
        if self._newest is not None:
            gap = (frame.index - self._newest - 1) & _FRAME
            self._lost += gap if gap < _HALF_RANGE else 0
        self._newest = frame.index
        self._arrived += 1
        self._partial += frame.partial

    def end(self, error: DeviceError | None = None) -> None:
        """Say that no frame follows, and why; the first reason stays."""
        with self._changed:
            if not self._ended:
                self._ended = True
                self._error = error
            self._changed.notify_all()

    def take(self) -> ReceivedFrame | None:
        """Wait for the oldest frame; None at a good end, and what was given to `end` is raised at a bad one."""
        with self._changed:
            self._changed.wait_for(lambda: self._frames or self._ended)
            if self._frames:
                return self._frames.popleft()
            if self._error is not None:
                raise self._error
            return None
