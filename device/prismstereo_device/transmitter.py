"""The writing half of the service: replies first, then the newest frame, packet by packet, while a host is heard."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from prismstereo_device.link import Link
from prismstereo_device.protocol import fragment
from prismstereo_device.session import Session
from prismstereo_device.source import ProducedFrame
from prismstereo_device.wire import FIRST, LAST, Channel

__all__ = ["Reply", "Transmitter"]

_POLL_S = 0.05
_WRITE_S = 0.1
_REPLIES = 64  # waiting at most; the host asks again for what was pushed out
_LOSSLESS_DEPTH = 2
_FRAME = 0xFFFF_FFFF


@dataclass(frozen=True, slots=True)
class Reply:
    """A small message that overtakes video; its body is made when its turn comes, so that its stamps are true."""

    session: Session
    channel: Channel
    body: Callable[[], bytes]
    flags: int = FIRST | LAST
    msg: int = 0


class Transmitter:
    """Writes to one link, in one thread (`run`), what other threads `post` and `offer`.

    The frame that waits is replaced by a newer one; with `lossless` the offering thread waits instead, and a frame that
    was cut short by a change of session is sent again from its start.
    """

    def __init__(self, link: Link, calibration_hash: bytes, stopping: threading.Event, *, lossless: bool) -> None:
        self._link = link
        self._calibration_hash = calibration_hash
        self._stopping = stopping
        self._lossless = lossless
        self._session = Session(0, time.monotonic())
        self._frames: queue.Queue[ProducedFrame] = queue.Queue(_LOSSLESS_DEPTH if lossless else 1)
        self._replies: deque[Reply] = deque(maxlen=_REPLIES)
        self._wake = threading.Event()
        self._finished = threading.Event()
        self._drained = threading.Event()
        self._torn = False  # the last packet was not written to its end
        self._sent = self._replaced = self._abandoned = 0

    @property
    def session(self) -> Session:
        """The session that is served now."""
        return self._session

    @property
    def sent(self) -> int:
        """Frames written to their last byte."""
        return self._sent

    @property
    def dropped(self) -> int:
        """Frames replaced by a newer one before they were sent, or cut short."""
        return self._replaced + self._abandoned

    @property
    def drained(self) -> bool:
        """Whether `finish` was called and every frame before it is written."""
        return self._drained.is_set()

    def adopt(self, session: Session) -> None:
        """Serve this session from now on; what was meant for the one before is forgotten."""
        self._session = session
        self._replies.clear()
        self._wake.set()

    def post(self, reply: Reply) -> None:
        """Let a reply out as soon as the packet that is being written has ended."""
        self._replies.append(reply)
        self._wake.set()

    def offer(self, frame: ProducedFrame) -> None:
        """Hand over the next frame; returns at once, or (lossless) when there is room or the service stops."""
        while not self._stopping.is_set():
            try:
                self._frames.put(frame, block=self._lossless, timeout=_WRITE_S)
            except queue.Full:
                if not self._lossless:
                    with contextlib.suppress(queue.Empty):
                        self._frames.get_nowait()
                        self._replaced += 1
            else:
                self._wake.set()
                return

    def finish(self) -> None:
        """Say that no frame will follow."""
        self._finished.set()
        self._wake.set()

    def wake(self) -> None:
        """Look again: the host has answered, or the service stops."""
        self._wake.set()

    def run(self) -> None:
        """Write until the service stops. Raises LinkLost."""
        frame: ProducedFrame | None = None
        while not self._stopping.is_set():
            self._wake.clear()
            self._write_replies()
            last = self._finished.is_set()
            session = self._session
            if session.may_stream(time.monotonic()):
                frame = frame or self._take()
                if frame is not None:
                    frame = self._send(session, frame)
                    continue
            if last and frame is None and self._frames.empty():
                self._drained.set()
            self._wake.wait(_POLL_S)

    def _take(self) -> ProducedFrame | None:
        with contextlib.suppress(queue.Empty):
            return self._frames.get_nowait()
        return None

    def _send(self, session: Session, frame: ProducedFrame) -> ProducedFrame | None:
        """Send a frame; returns it where it has to be sent again."""
        if self._write_frame(session, frame):
            self._sent += 1
            return None
        if self._lossless:
            return frame
        self._abandoned += 1
        return None

    def _write_frame(self, session: Session, frame: ProducedFrame) -> bool:
        number = frame.index & _FRAME
        packets = fragment(
            frame.disparity,
            frame=number,
            timestamp_us=frame.timestamp_us,
            calibration_hash=self._calibration_hash,
            lens_position=frame.lens_position,
            mtu=self._link.mtu,
        )
        session.begin_frame(number)
        for flags, index, payload in packets:
            self._write_replies()
            if not self._heard(session):
                return False
            data = session.framer.encode(Channel.DISP, payload, flags=flags, msg=number, frag=index)
            if not self._write(session, data):
                return False
        session.end_frame(time.monotonic())
        return True

    def _write_replies(self) -> None:
        with contextlib.suppress(IndexError):
            while True:
                reply = self._replies.popleft()
                framer = reply.session.framer
                data = framer.encode(reply.channel, reply.body(), flags=reply.flags, msg=reply.msg)
                self._write(reply.session, data)

    def _write(self, session: Session, data: bytes) -> bool:
        """Write a whole packet, for as long as its session is heard; returns whether it is out."""
        if self._torn:
            data = b"\0" + data  # close the packet that was cut short, or this one would be lost with it
        while True:
            taken = self._link.write(data, _WRITE_S)
            data = data[taken:]
            if not data:
                self._torn = False
                return True
            if not self._heard(session):
                self._torn = True
                return False

    def _heard(self, session: Session) -> bool:
        return session is self._session and session.alive(time.monotonic()) and not self._stopping.is_set()
