"""What arrives in a session, put where it belongs: frames, answers, pictures, the clock, the device's own report."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from prismstereo.camera_frame import CameraFrame, FrameCamera, FrameCounter
from prismstereo.clock import ClockFit, ClockMapping, Probe
from prismstereo.connection import Connection
from prismstereo.events import CameraEvent
from prismstereo.frame_pictures import FramePictures
from prismstereo.inbox import Inbox, Stream
from prismstereo.line_loss import LineLoss
from prismstereo.requests import Requests
from prismstereo.round_trip import RoundTrip
from prismstereo_device.framing import Packet
from prismstereo_device.link import LinkLost
from prismstereo_device.protocol import (
    FrameAck,
    FrameAssembler,
    Health,
    HealthFlag,
    PictureAssembler,
    Ping,
    Pong,
    ReceivedFrame,
    ReceivedPicture,
    ZonesMessage,
    read_control,
)
from prismstereo_device.wire import LIMITS, REPLY, Channel, WireError
from prismstereo_device.zones import ZoneDistances
from prismstereo_hw.errors import DeviceError

__all__ = ["Reception"]

_ACK_EVERY_S = 0.1
_PING_EVERY_S = 1.0
_FIRST_PINGS = 8
_FIRST_PINGS_EVERY_S = 0.1
_QUIET_S = 0.25  # a line with nothing to say is pinged so often, so that silence always means something
_OF_FRAMES = (Channel.IMG, Channel.REASON, Channel.CONFIDENCE, Channel.ZONES)  # kept until a frame is asked for them


class Reception:
    """A `Listener`: keeps the session's assemblers, inboxes and requests, and beats for them; its frames are `camera`'s."""

    def __init__(self, connection: Connection, inbox: Inbox[CameraFrame], camera: FrameCamera) -> None:
        self._connection = connection
        self._camera = camera
        self.inbox = inbox
        self.frame_pictures = FramePictures()
        self.on_event: list[Callable[[CameraEvent], None]] = []
        self.on_packet: list[Callable[[Packet, int, int], None]] = []
        round_trip = RoundTrip()
        self.commands = Requests(Channel.CMD, connection.request, round_trip)
        self.bulk = Requests(Channel.BULK, connection.request, round_trip)
        self.health: Health | None = None
        self.round_trip_us: int | None = None
        self.frame_hash = b""
        self._counter = FrameCounter()
        self._assembler = FrameAssembler()
        self._pictures: dict[int, PictureAssembler] = {}
        self._malformed = 0
        self._clock = ClockFit()
        self._loss = LineLoss()
        self._session = connection.counts.sessions
        self._streams: dict[int, list[Inbox[object]]] = {}
        self._joining = threading.Lock()
        self._over = False
        self._lost: DeviceError | None = None
        self._told: FrameAck | None = None
        self._ack_at_s = self._ping_at_s = 0.0
        self._pings = 0
        self._heard_at_s = time.monotonic()
        for requests in (self.commands, self.bulk):
            requests.begin_session(self._session)

    @property
    def counter(self) -> FrameCounter:
        """Frames over all sessions."""
        return self._counter

    @property
    def malformed(self) -> int:
        """Messages that came in good packets and could not be read."""
        return self._malformed + self._assembler.statistics.malformed

    @property
    def clock(self) -> ClockMapping | None:
        """The device's clock as seen from here; None before the first pong."""
        return self._clock.mapping

    def stream(self, channel: Channel, capacity: int) -> Stream[object]:
        """Let what arrives on a channel from now on be kept for a new reader."""
        inbox: Inbox[object] = Inbox(capacity)
        with self._joining:
            self._streams[channel] = [*self._streams.get(channel, []), inbox]
            if self._over or (channel == Channel.DISP and self.inbox.ended):
                inbox.end(self._lost)  # whoever comes late is told so
        return Stream(inbox, lambda leaving: self._leave(channel, leaving))

    def end(self, error: DeviceError | None) -> None:
        """Let nobody wait any longer."""
        over = error or LinkLost(f"the sensor on {self._connection.name} was closed: open it again")
        self.commands.end(over)
        self.bulk.end(over)
        self.inbox.end(error)
        with self._joining:
            self._over, self._lost = True, error
            for inboxes in self._streams.values():
                for inbox in inboxes:
                    inbox.end(error)

    def taken(self) -> None:
        """Hear that a frame was taken out of the inbox: a camera that waits is told."""
        if self._told is not None and self._told.room == 0 and self._room > 0:
            self._ack_at_s = 0.0
            self._connection.wake()

    def hear(self, packet: Packet, heard_us: int) -> None:
        """Take a packet."""
        self._heard_at_s = time.monotonic()
        for callback in tuple(self.on_packet):
            callback(packet, heard_us, self._session)
        self._loss.count(packet)
        try:
            match packet.channel:
                case Channel.DISP:
                    self._deliver(self._assembler.feed(packet), heard_us)
                    started = self._assembler.newest_started
                    if started is not None and (self._told is None or self._told.newest_frame != started):
                        self._ack_at_s = 0.0
                        self._connection.wake()
                case Channel.CTRL:
                    self._control(packet, heard_us)
                case Channel.CMD:
                    self.commands.take(packet)
                case Channel.BULK:
                    self.bulk.take(packet)
                case Channel.HEALTH:
                    self._report(Health.unpack(packet.payload))
                case _:
                    self._hand_out(packet)
        except WireError:
            self._malformed += 1

    def begin_session(self, session: int, *, same_boot: bool) -> None:
        """Finish what was under way, and begin anew."""
        self._deliver(self._assembler.flush())
        self._malformed += self._assembler.statistics.malformed
        self._session = session
        self._assembler, self._pictures, self._told = FrameAssembler(), {}, None
        self._loss.begin_session()
        self._pings, self._ping_at_s = 0, 0.0
        if not same_boot:
            self._clock.reset()
            self._counter.restart()
        self.commands.begin_session(session)
        self.bulk.begin_session(session)

    def tell(self, event: CameraEvent) -> None:
        """Pass an event on."""
        for callback in tuple(self.on_event):
            callback(event)

    def lose(self, error: DeviceError) -> None:
        """End everything: the frames so far are delivered first."""
        self._deliver(self._assembler.flush())
        frames = self._counter.counts.frames
        text = f"the sensor on {self._connection.name} was lost after {frames} frames: {error}"
        self.end(LinkLost(text) if isinstance(error, LinkLost) else DeviceError(text))

    def beat(self, now_s: float) -> float:
        """Acknowledge, ping, and ask again."""
        if now_s >= self._ack_at_s:
            self._ack_at_s = now_s + _ACK_EVERY_S  # first: what starts from here on asks for an ack of its own
            started = self._assembler.newest_started
            if started is not None:
                loss = self._loss.permille(self._connection.line.bad, now_s)
                self._told = told = FrameAck(started, self._room, loss)
                self._connection.send(Channel.CTRL, told.pack)
        quiet = now_s - self._heard_at_s > _QUIET_S and now_s >= self._ping_at_s - _PING_EVERY_S + _QUIET_S
        if now_s >= self._ping_at_s or quiet:
            self._pings += 1
            self._ping_at_s = now_s + (_PING_EVERY_S if self._pings >= _FIRST_PINGS else _FIRST_PINGS_EVERY_S)
            self._connection.send(Channel.CTRL, lambda: Ping(_clock_us()).pack())
        return min(self.commands.tick(), self.bulk.tick(), self._ping_at_s)

    @property
    def _room(self) -> int:
        room = self.inbox.room
        return LIMITS.frames_unacknowledged if room is None else min(room, LIMITS.frames_unacknowledged)

    def _deliver(self, frames: list[ReceivedFrame], heard_us: int | None = None) -> None:
        for frame in frames:
            self._counter.count(frame)
            self.frame_hash = frame.calibration_hash
            heard = _clock_us() if heard_us is None else heard_us
            whole = CameraFrame.of(frame, self._session, heard_us=heard, clock=self.clock, camera=self._camera)
            self.inbox.put(whole)
            self._give(Channel.DISP, whole)

    def _control(self, packet: Packet, heard_us: int) -> None:
        match read_control(packet.payload):
            case Ping(t_host_us):
                self._connection.send(
                    Channel.CTRL, lambda: Pong(t_host_us, heard_us, _clock_us()).pack(), REPLY, packet.msg
                )
            case Pong(t_host_us, t_rx_us, t_tx_us):
                probe = Probe(t_host_us, t_rx_us, t_tx_us, heard_us)
                self.round_trip_us = probe.round_trip_us
                self._clock.add(probe)

    def _report(self, health: Health) -> None:
        self.health = health
        self._give(Channel.HEALTH, health)
        if HealthFlag.END_OF_STREAM in health.flags:
            self._deliver(self._assembler.flush())
            error = None
            if HealthFlag.SOURCE_FAILED in health.flags:
                frames = self._counter.counts.frames
                mend = "its own log says why; restart it"
                error = DeviceError(f"the sensor on {self._connection.name} broke after {frames} frames: {mend}")
            self.inbox.end(error)
            for inbox in self._streams.get(Channel.DISP, ()):
                inbox.end(error)

    def _hand_out(self, packet: Packet) -> None:
        """Read what belongs to frames, or has readers of its own; raw frames without one are not even put together."""
        if packet.channel not in _OF_FRAMES and not self._streams.get(packet.channel):
            return
        if packet.channel == Channel.ZONES:
            zones: ZoneDistances = ZonesMessage.unpack(packet.payload).zones
            self.frame_pictures.put_zones(self._session, zones)
            self._give(packet.channel, zones)
            return
        pictures: list[ReceivedPicture] = self._pictures.setdefault(packet.channel, PictureAssembler()).feed(packet)
        for picture in pictures:
            if packet.channel in _OF_FRAMES:
                self.frame_pictures.put(self._session, picture)
            self._give(packet.channel, picture)

    def _give(self, channel: int, item: object) -> None:
        for inbox in self._streams.get(channel, ()):
            inbox.put(item)

    def _leave(self, channel: Channel, leaving: Inbox[object]) -> None:
        with self._joining:
            self._streams[channel] = [inbox for inbox in self._streams.get(channel, []) if inbox is not leaving]


def _clock_us() -> int:
    return time.monotonic_ns() // 1000
