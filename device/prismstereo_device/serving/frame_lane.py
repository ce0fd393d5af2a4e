"""Disparity on its way out: the newest frame that waits, and the one whose packets are going out."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.protocol.frames import fragment
from prismstereo_device.serving.rate_control import HALVED, Mode, RateControl, halved
from prismstereo_device.serving.session import Session
from prismstereo_device.source import ProducedFrame
from prismstereo_device.wire import LAST, Channel

__all__ = ["FrameLane"]

_FRAME = 0xFFFF_FFFF
_PAUSE_S = 2.0  # frames further apart do not tell the source's rate: it had stopped

Part = tuple[int, int, bytes]


@dataclass(slots=True)
class _Going:
    """A frame whose packets go out: how many bytes are out, and how long the line was busy with it."""

    session: Session
    frame: ProducedFrame
    mode: Mode | None
    parts: Iterator[Part]
    line_s: float
    coding_s: float = 0.0
    size: int = 0
    ended: bool = False


class FrameLane:
    """The newest frame wins: one that waits is replaced by the next, which is counted; one that has begun is finished.

    A frame that is cut short by the end of its session is counted as dropped; with `lossless` it is sent again from its
    start. One thread puts frames in, another takes packets out. Times are seconds of one monotonic clock.
    """

    def __init__(self, rate_control: RateControl, mtu: int, *, lossless: bool) -> None:
        self._rate_control = rate_control
        self._mtu = mtu
        self._lossless = lossless
        self._lock = threading.Lock()
        self._waiting: ProducedFrame | None = None
        self._going: _Going | None = None
        self._put_at_s: float | None = None
        self._periods: list[float] = []
        self._blocked_at_s: float | None = None  # since when a frame waits for the host's word on those before it
        self.sent = self.dropped = 0

    def put(self, frame: ProducedFrame, now_s: float) -> None:
        """Take the newest frame."""
        with self._lock:
            period_s = _PAUSE_S if self._put_at_s is None else now_s - self._put_at_s
            self._put_at_s = now_s
            if period_s < _PAUSE_S:
                self._periods.append(period_s)
                del self._periods[:-8]
            self.dropped += self._waiting is not None
            self._waiting = frame

    @property
    def idle(self) -> bool:
        """Whether nothing waits and nothing is going out."""
        return self._waiting is None and self._going is None

    def wants(self, session: Session, now_s: float) -> bool:
        """Whether there is a packet to send in this session; what belongs to another one, or to a dead one, is cut."""
        if self._going is not None:
            if self._going.session is session and session.alive(now_s):
                return True
            self.cut()
        if self._waiting is None:
            return False
        if session.may_stream(now_s):
            return True
        if not session.listening(now_s):
            self._blocked_at_s = None
        elif self._blocked_at_s is None:
            self._blocked_at_s = now_s
        return False

    def packet(self, session: Session, now_s: float) -> bytes:
        """Give the next packet's bytes; only after `wants`. A new frame is coded now. Raises WireError."""
        new = self._going is None
        if new:
            self._begin(session, now_s)
        going = self._going
        assert going is not None
        flags, index, payload = next(going.parts)
        if new:
            going.coding_s = time.monotonic() - now_s
        going.ended = bool(flags & LAST)
        data = session.framer.encode(Channel.DISP, payload, flags=flags, msg=going.frame.index, frag=index)
        going.size += len(data)
        return data

    def _begin(self, session: Session, now_s: float) -> None:
        with self._lock:
            frame, self._waiting = self._waiting, None
        assert frame is not None
        assert frame.disparity is not None
        waited_s = 0.0 if self._blocked_at_s is None else now_s - self._blocked_at_s
        self._blocked_at_s = None
        mode = self._rate_control.mode_for(frame.disparity.disparity_px.size) if session.compact else None
        parts = _parts(frame, frame.disparity, mode, session, self._mtu)
        session.begin_frame(frame.index & _FRAME)
        self._going = _Going(session, frame, mode, parts, waited_s)

    def busy(self, line_s: float) -> None:
        """Note how long the line was busy, be it with a packet of another kind."""
        if self._going is not None:
            self._going.line_s += line_s

    def written(self, now_s: float) -> None:
        """Note that the last packet given is out."""
        going = self._going
        assert going is not None
        if not going.ended:
            return
        going.session.end_frame(now_s)
        self._going = None
        self.sent += 1
        if going.mode is not None and not self._lossless:
            self._rate_control.sent(
                going.mode,
                going.size,
                going.line_s,
                now_s,
                source_s=self._source_s(),
                coding_s=going.coding_s,
            )

    def cut(self) -> None:
        """Give up the frame that is going out: its session is over."""
        going, self._going = self._going, None
        if going is None:
            return
        if self._lossless:
            self._waiting = going.frame
        else:
            self.dropped += 1

    def _source_s(self) -> float | None:
        with self._lock:
            return sum(self._periods) / len(self._periods) if self._periods else None


def _parts(
    frame: ProducedFrame, disparity: DisparityMap, mode: Mode | None, session: Session, mtu: int
) -> Iterator[Part]:
    """Code a frame: (flags, fragment index, payload) each; the head twice where many packets are lost."""
    small = mode is not None and mode.halved
    parts = fragment(
        halved(disparity) if small else disparity,
        frame=frame.index & _FRAME,
        timestamp_us=frame.timestamp_us,
        calibration_hash=frame.calibration_hash,
        lens_position=frame.lens_position,
        filter_set=frame.filter_set | (HALVED if small else 0),
        bound=None if mode is None else mode.bound,
        mtu=session.video_mtu(mtu),
    )
    if session.lossy:
        head = next(parts)
        yield head
        yield head
    yield from parts
