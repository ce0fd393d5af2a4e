"""A recording in the place of the camera: the same bytes on a line that leads to no device.

Every packet goes through framing, assembly and decoding as it did when it was recorded.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import msgspec

from prismstereo.recording.chunk import Damage
from prismstereo.recording.playhead import Playhead
from prismstereo.recording.recording import Recording
from prismstereo.recording.replies import answer_bulk, answer_command, answer_hello, answer_ping, first_session
from prismstereo_device.framing import Deframer, Framer, Packet
from prismstereo_device.link import Link, LinkLost
from prismstereo_device.protocol import (
    DisparityHead,
    FrameAck,
    Health,
    HealthFlag,
    Hello,
    HelloKind,
    Ping,
    read_control,
    read_hello,
)
from prismstereo_device.wire import FIRST, LAST, LIMITS, REPLY, Channel, WireError
from prismstereo_hw.errors import UsageError

__all__ = ["RecordingLink"]

_SENT_AT_ONCE = 65536
_FORGIVE_S = 1.0
_RECHECK_S = 0.1
_HALF_RANGE = 1 << 31
_REPLAYED = (
    Channel.DISP, Channel.IMG, Channel.HEALTH, Channel.ZONES, Channel.REASON, Channel.CONFIDENCE, Channel.RAW,
)  # fmt: skip


class RecordingLink(Link):
    """The host's end of a line to a recording, which it owns. `RecordingError` for a file that is none.

    It begins `start_s` seconds from the beginning. `pace` 1 is as it was, None as fast as it is read: then nothing is lost, for
    a frame waits until the one three before it has arrived. Where the recorded camera started anew, this one does. At the end
    it says that its stream has ended, unless it is to `stay`, so that somebody can `seek`.
    """

    def __init__(self, path: str | Path, *, pace: float | None = 1.0, start_s: float = 0.0, stay: bool = False) -> None:
        if pace is not None and not 0 < pace <= 1000:
            raise UsageError(f"a pace of {pace:g}: above 0, at most 1000, or none for as fast as it is read")
        super().__init__(str(path))
        self.recording = Recording(path)
        self._playhead = Playhead(self.recording, pace, start_s)
        self._stay = stay
        self._changed = threading.Condition()
        self._closed = self._paused = self._streaming = self._ended = False
        self._session = first_session(self.recording)
        self._seeks = 0
        self._nonce = 0
        self._deframer, self._framer = Deframer(), Framer(0)
        self._replies: deque[bytes] = deque()
        self._in_flight: deque[int] = deque()
        self._room = LIMITS.frames_unacknowledged
        self._moved_at_s = 0.0
        self._frame_hash = b""
        self._health = Health(0, 0, 0, 0, 0, 0, 0)

    @property
    def damage(self) -> Damage:
        """What could not be read so far, and was left out."""
        return self._playhead.damage

    @property
    def length_s(self) -> float:
        """How long the recording is."""
        return self.recording.length_s

    @property
    def position_s(self) -> float:
        """How far into the recording the replay is."""
        return self._playhead.position_s

    @property
    def paused(self) -> bool:
        """Whether the replay stands still."""
        return self._paused

    def pause(self) -> None:
        """Let the replay stand still; whoever reads still gets answers."""
        with self._changed:
            self._paused = True
            self._playhead.halt()

    def resume(self) -> None:
        """Let the replay go on."""
        with self._changed:
            self._paused = False
            self._changed.notify_all()

    def seek(self, position_s: float) -> None:
        """Go to so many seconds from the beginning. To the host the camera has started anew: its frames begin elsewhere."""
        with self._changed:
            self._playhead.move(min(max(0.0, position_s), self.length_s))
            self._seeks += 1
            self._ended = False
            if self._nonce:
                self._start_anew()
            self._changed.notify_all()

    def read(self, timeout_s: float) -> bytes:
        """Wait for at least one byte and return everything that is there; b"" when the time is over."""
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while True:
                if self._closed:
                    raise LinkLost(f"the recording {self.name} is closed")
                if self._replies:
                    data = b"".join(self._replies)
                    self._replies.clear()
                    return data
                data, wait_s = self._due()
                if data:
                    return data
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    return b""
                self._changed.wait(min(left_s, wait_s))

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        """Take what the host says, and answer it."""
        del timeout_s
        with self._changed:
            if self._closed:
                raise LinkLost(f"the recording {self.name} is closed")
            for packet in self._deframer.feed(data):
                with suppress(WireError):
                    self._hear(packet)
            self._changed.notify_all()
        return len(data)

    def close(self) -> None:
        """Give the file back; closing twice does no harm."""
        with self._changed:
            self._closed = True
            self.recording.close()
            self._changed.notify_all()

    def _hear(self, packet: Packet) -> None:
        match packet.channel:
            case Channel.HELLO:
                self._meet(packet)
            case Channel.CTRL:
                self._control(packet)
            case Channel.CMD:
                self._answer(Channel.CMD, answer_command(), packet.msg)
            case Channel.BULK:
                self._answer(Channel.BULK, answer_bulk(packet.payload, self.recording, self._calibration), packet.msg)

    def _meet(self, packet: Packet) -> None:
        hello = read_hello(packet.payload)
        if not isinstance(hello, Hello) or hello.kind is not HelloKind.OFFER:
            return
        if hello.shared_version() is None:
            self._answer(Channel.HELLO, Hello(hello.nonce, kind=HelloKind.REFUSE).pack(), packet.msg)
            return
        if hello.nonce != self._nonce:
            self._nonce = hello.nonce
            self._deframer.adopt(hello.nonce)
            self._framer = Framer(hello.nonce)
            self._in_flight.clear()
            self._room = LIMITS.frames_unacknowledged
            self._streaming = True
            self._playhead.halt()
        self._answer(Channel.HELLO, self._greeting(), packet.msg)

    def _control(self, packet: Packet) -> None:
        match read_control(packet.payload):
            case Ping(t_host_us):
                recorded_us = self._playhead.recorded_us()
                clock = None if recorded_us is None else self._playhead.clock
                self._answer(Channel.CTRL, answer_ping(t_host_us, clock, recorded_us or 0), packet.msg)
            case FrameAck(newest_frame, room):
                self._room = room
                while self._in_flight and (newest_frame - self._in_flight[0]) & 0xFFFF_FFFF < _HALF_RANGE:
                    self._in_flight.popleft()
                    self._moved_at_s = time.monotonic()

    def _answer(self, channel: Channel, body: bytes, msg: int) -> None:
        self._replies.append(self._framer.encode(channel, body, flags=FIRST | LAST | REPLY, msg=msg))

    def _greeting(self) -> bytes:
        return answer_hello(self._session, self._nonce, self._session.boot_id + self._seeks, self._calibration)

    def _start_anew(self) -> None:
        """Let the host find a camera that has forgotten it, and wait for its next hello."""
        self._streaming = False
        self._answer(Channel.HELLO, self._greeting(), 0)

    @property
    def _calibration(self) -> bytes | None:
        """What the camera held when it sent its last frame, or at the latest meeting."""
        found = self.recording.calibration(self._frame_hash) if any(self._frame_hash) else None
        return found or self.recording.calibration(bytes.fromhex(self._session.calibration_hash))

    def _due(self) -> tuple[bytes, float]:
        """Give the bytes that are due, and how long to wait for more."""
        data = bytearray()
        wait_s = _RECHECK_S
        while self._streaming and not (self._paused or self._ended) and len(data) < _SENT_AT_ONCE:
            stored = self._playhead.next
            if stored is None:
                data += self._end()
                break
            if self._begins_session(stored.session):
                break
            wait_s = self._playhead.due_in_s()
            if wait_s > 0 or not self._may_send(stored.packet):
                break
            data += self._encoded(stored.packet)
            self._playhead.advance()
        return bytes(data), max(wait_s, 0.001)

    def _begins_session(self, number: int) -> bool:
        """Whether the next packet is of a camera that has started anew, so that the host has to meet it first."""
        if number == self._session.session:
            return False
        former = self._session
        unknown = msgspec.structs.replace(former, session=number, boot_id=former.boot_id + 1)
        self._session = self.recording.sessions.get(number, unknown)
        self._frame_hash = b""
        if self._session.boot_id == former.boot_id:
            return False
        self._start_anew()
        return True

    def _may_send(self, packet: Packet) -> bool:
        """Whether the host has room for another frame; what is no start of a frame belongs to one that had room."""
        if packet.channel != Channel.DISP or not packet.flags & FIRST:
            return True
        try:
            head = DisparityHead.unpack(packet.payload)
        except WireError:
            return True
        if head.frame not in self._in_flight:
            now_s = time.monotonic()
            if len(self._in_flight) >= min(self._room, LIMITS.frames_unacknowledged):
                if not self._room or now_s - self._moved_at_s < _FORGIVE_S:
                    return False
                self._in_flight.clear()  # heads that the host could make nothing of
            self._in_flight.append(head.frame)
            self._moved_at_s = now_s
        self._frame_hash = head.calibration_hash
        return True

    def _encoded(self, packet: Packet) -> bytes:
        if packet.channel not in _REPLAYED:
            return b""
        payload = packet.payload
        if packet.channel == Channel.HEALTH:
            with suppress(WireError):
                self._health = replace(Health.unpack(payload), flags=HealthFlag.NONE)
                payload = self._health.pack()  # the stream does not end before the recording does
        return self._framer.encode(packet.channel, payload, flags=packet.flags, msg=packet.msg, frag=packet.frag)

    def _end(self) -> bytes:
        self._ended = True
        if self._stay:
            return b""
        end = replace(self._health, flags=HealthFlag.END_OF_STREAM)
        return self._framer.encode(Channel.HEALTH, end.pack())
