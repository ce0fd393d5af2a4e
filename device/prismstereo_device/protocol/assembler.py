"""Whole frames on their way in: packets to disparity maps.

Video is never sent again. What is lost is delivered as unmatched pixels, and the frame says that it is `partial`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from prismstereo_device.framing import Packet
from prismstereo_device.protocol.fragments import read_fragment
from prismstereo_device.protocol.frame_head import DisparityHead
from prismstereo_device.protocol.open_frame import OpenFrame, ReceivedFrame
from prismstereo_device.wire import FIRST, LAST, LIMITS, WireError

__all__ = ["AssemblyStatistics", "FrameAssembler"]

_HALF_RANGE = 1 << 31
_FRAME = 0xFFFF_FFFF
_REMEMBERED = 16  # frames that have ended and whose late packets open nothing


@dataclass(frozen=True, slots=True)
class AssemblyStatistics:
    """What could not be used: `malformed` packets, `stray` ones of no open frame, stripes `without_tables`."""

    malformed: int = 0
    stray: int = 0
    without_tables: int = 0


class FrameAssembler:
    """Puts the frames of one session together; never raises, whatever the packets hold.

    A frame is finished by its last fragment, by the start of a newer frame, or when too many are open. A head that comes
    again is ignored, be its frame still open or not.
    """

    def __init__(self) -> None:
        self._open: dict[int, OpenFrame] = {}
        self._ended: deque[int] = deque(maxlen=_REMEMBERED)
        self._newest_started: int | None = None
        self._malformed = self._stray = self._without_tables = 0

    @property
    def newest_started(self) -> int | None:
        """Number of the newest frame whose head was seen; None before the first."""
        return self._newest_started

    @property
    def statistics(self) -> AssemblyStatistics:
        """The counters so far."""
        return AssemblyStatistics(self._malformed, self._stray, self._without_tables)

    def feed(self, packet: Packet) -> list[ReceivedFrame]:
        """Take one packet of the disparity channel and return the frames that it finishes, oldest first."""
        try:
            if packet.flags & FIRST:
                return self._start(packet)
            return self._continue(packet)
        except WireError:
            self._malformed += 1
            return []

    def flush(self) -> list[ReceivedFrame]:
        """Finish every open frame, oldest first: the stream has ended."""
        return [self._finish(number) for number in tuple(self._open)]

    def _start(self, packet: Packet) -> list[ReceivedFrame]:
        head = DisparityHead.unpack(packet.payload)
        if head.frame in self._open or head.frame in self._ended:
            return []  # the head was sent twice, or came late
        opened = OpenFrame(head)
        newest = self._newest_started
        finished = []
        if newest is None or 0 < (head.frame - newest) & _FRAME < _HALF_RANGE:
            finished = self.flush()
            self._newest_started = head.frame
        elif len(self._open) >= LIMITS.frames_in_assembly:
            finished = [self._finish(next(iter(self._open)))]
        self._open[head.frame] = opened
        return finished + self._end(head.frame, packet)

    def _continue(self, packet: Packet) -> list[ReceivedFrame]:
        pieces = read_fragment(packet.payload)
        if not pieces or pieces[0].frame not in self._open:
            self._stray += 1
            return []
        frame = pieces[0].frame
        for piece in pieces:
            try:
                self._without_tables += not self._open[frame].add(piece)
            except WireError:
                self._malformed += 1
        return self._end(frame, packet)

    def _end(self, frame: int, packet: Packet) -> list[ReceivedFrame]:
        return [self._finish(frame)] if packet.flags & LAST else []

    def _finish(self, frame: int) -> ReceivedFrame:
        self._ended.append(frame)
        return self._open.pop(frame).finish()
