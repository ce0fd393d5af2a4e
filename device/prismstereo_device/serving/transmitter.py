"""The writing half of the service: after each packet it looks again whose turn it is, while a host is heard."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from prismstereo_device.link import Link
from prismstereo_device.protocol.zones import ZonesMessage
from prismstereo_device.serving.frame_lane import FrameLane
from prismstereo_device.serving.picture_lanes import PictureLanes
from prismstereo_device.serving.rate_control import RateControl
from prismstereo_device.serving.schedule import TURN_OF, Schedule, Turn
from prismstereo_device.serving.session import Session
from prismstereo_device.source import ProducedFrame
from prismstereo_device.wire import FIRST, LAST, Channel

__all__ = ["Reply", "Transmitter"]

_POLL_S = 0.05
_WRITE_S = 0.1
_REPLIES = 64  # of each kind, waiting at most; the host asks again for what was pushed out
_LOSSLESS_DEPTH = 2


@dataclass(frozen=True, slots=True)
class Reply:
    """A message of one packet; its body is made when its turn comes, so that its stamps are true."""

    session: Session
    channel: Channel
    body: Callable[[], bytes]
    flags: int = FIRST | LAST
    msg: int = 0


class Transmitter:
    """Writes to one link, in one thread (`run`), what other threads `post` and `offer`.

    A frame or picture that waits is replaced by a newer one; with `lossless` the offering thread waits instead, and what was
    cut short by a change of session is sent again from its start.
    """

    def __init__(self, link: Link, rate_control: RateControl, stopping: threading.Event, *, lossless: bool) -> None:
        self._link = link
        self._stopping = stopping
        self._lossless = lossless
        self._session = Session(0, time.monotonic())
        self._schedule = Schedule()
        self._replies: dict[Turn, deque[Reply]] = {turn: deque(maxlen=_REPLIES) for turn in set(TURN_OF.values())}
        self._frames = FrameLane(rate_control, link.mtu, lossless=lossless)
        self._wake = threading.Event()
        self._pictures = PictureLanes(link.mtu, self._wake.set, lossless=lossless)
        self._queue: queue.Queue[ProducedFrame] = queue.Queue(_LOSSLESS_DEPTH)  # lossless alone has one
        self._zones: ZonesMessage | None = None  # the newest
        self._finished = threading.Event()
        self._drained = threading.Event()
        self._torn = False  # the last packet was not written to its end
        self._written_bytes = 0

    @property
    def session(self) -> Session:
        """The session that is served now."""
        return self._session

    @property
    def sent(self) -> int:
        """Disparity frames written to their last byte."""
        return self._frames.sent

    @property
    def dropped(self) -> int:
        """Disparity frames replaced by a newer one before they were sent, or cut short."""
        return self._frames.dropped

    @property
    def pictures_dropped(self) -> int:
        """Pictures of every kind that were replaced before they were sent, cut short, or could not be compressed."""
        return self._pictures.dropped

    @property
    def written_bytes(self) -> int:
        """All bytes that were handed to the link."""
        return self._written_bytes

    @property
    def drained(self) -> bool:
        """Whether `finish` was called and every frame before it is written."""
        return self._drained.is_set()

    def adopt(self, session: Session) -> None:
        """Serve another session from the next packet on; what was meant for the one before is not sent."""
        self._session = session
        self._wake.set()

    def post(self, reply: Reply) -> None:
        """Queue a reply."""
        self._replies[TURN_OF[reply.channel]].append(reply)
        self._wake.set()

    def offer(self, frame: ProducedFrame, waiting: Callable[[], None] = lambda: None) -> None:
        """Hand over the next frame; returns at once, or (lossless) when there is room or the service stops.

        `waiting` is called again and again while there is no room.
        """
        if not self._lossless:
            self._take_in(frame)
            self._wake.set()
            return
        while not self._stopping.is_set():
            with contextlib.suppress(queue.Full):
                self._queue.put(frame, timeout=_WRITE_S)
                self._wake.set()
                return
            waiting()

    def finish(self) -> None:
        """Say that no frame will follow."""
        self._finished.set()
        self._wake.set()

    def wake(self) -> None:
        """Look again: the host has answered, or the service stops."""
        self._wake.set()

    def run(self) -> None:
        """Write until the service stops. Raises LinkLost."""
        try:
            while not self._stopping.is_set():
                self._wake.clear()
                finished = self._finished.is_set()
                self._next_frame()
                session = self._session
                turn = self._schedule.choose(self._waiting(session, time.monotonic()))
                if turn is not None:
                    self._take_turn(turn, session)
                    continue
                if finished and self._idle:
                    self._drained.set()
                self._wake.wait(_POLL_S)
        finally:
            self._pictures.close()

    @property
    def _idle(self) -> bool:
        return self._queue.empty() and self._frames.idle and self._pictures.idle

    def _next_frame(self) -> None:
        """Take in the next frame of a lossless stream once all of the one before is out."""
        if self._lossless and self._frames.idle and self._pictures.idle:
            with contextlib.suppress(queue.Empty):
                self._take_in(self._queue.get_nowait())

    def _take_in(self, frame: ProducedFrame) -> None:
        if frame.disparity is not None:
            self._frames.put(frame, time.monotonic())
        if frame.zones is not None:
            self._zones = ZonesMessage(frame.zones)
        self._pictures.put(frame)

    def _waiting(self, session: Session, now_s: float) -> list[Turn]:
        waiting = [turn for turn, replies in self._replies.items() if replies]
        if self._zones is not None and session.listening(now_s):
            waiting.append(Turn.REPORT)
        if self._frames.wants(session, now_s):
            waiting.append(Turn.FRAME)
        if self._pictures.wants(session, now_s):
            waiting.append(Turn.PICTURE)
        return waiting

    def _take_turn(self, turn: Turn, session: Session) -> None:
        if turn is Turn.FRAME:
            self._send_frame(session)
        elif turn is Turn.PICTURE:
            self._send_picture(session)
        elif self._replies[turn]:
            self._send_reply(self._replies[turn].popleft())
        else:
            self._send_zones(session)

    def _send_frame(self, session: Session) -> None:
        data = self._frames.packet(session, time.monotonic())
        if self._write(session, data):
            self._frames.written(time.monotonic())
        else:
            self._frames.cut()

    def _send_picture(self, session: Session) -> None:
        data = self._pictures.packet(session)
        if data is None:
            return
        if self._write(session, data):
            self._pictures.written()
        else:
            self._pictures.cut()

    def _send_zones(self, session: Session) -> None:
        zones, self._zones = self._zones, None
        if zones is not None:
            self._write(session, session.framer.encode(Channel.ZONES, zones.pack(), msg=zones.zones.index))

    def _send_reply(self, reply: Reply) -> None:
        if reply.session is self._session:
            data = reply.session.framer.encode(reply.channel, reply.body(), flags=reply.flags, msg=reply.msg)
            self._write(reply.session, data)

    def _write(self, session: Session, data: bytes) -> bool:
        """Write a whole packet, for as long as its session is heard; returns whether it is out."""
        if self._torn:
            data = b"\0" + data  # close the packet that was cut short, or this one would be lost with it
        while True:
            began_s = time.monotonic()
            taken = self._link.write(data, _WRITE_S)
            self._frames.busy(time.monotonic() - began_s)
            self._written_bytes += taken
            data = data[taken:]
            if not data:
                self._torn = False
                return True
            if not self._heard(session):
                self._torn = True
                return False

    def _heard(self, session: Session) -> bool:
        return session is self._session and session.alive(time.monotonic()) and not self._stopping.is_set()
