"""The camera's service: frames of a source to whichever host says hello.

Three threads: one computes (it sits in the source), one listens and keeps the pulse, one writes. A source that computes
for seconds so delays no answer and no heartbeat. The newest frame wins: what the line has no room for is dropped before
it is compressed, and counted. A *lossless* service makes the source wait instead.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Self

from prismstereo_device.framing import Deframer, LineStatistics, Packet
from prismstereo_device.link import Link
from prismstereo_device.protocol import (
    CALIBRATION,
    FrameAck,
    Health,
    HealthFlag,
    Hello,
    HelloKind,
    HelloReply,
    Ping,
    Pong,
    ReadRequest,
    answer_read,
    calibration_hash,
    read_control,
    read_hello,
)
from prismstereo_device.session import Session
from prismstereo_device.source import FrameSource, ProducedFrame
from prismstereo_device.transmitter import Reply, Transmitter
from prismstereo_device.wire import FIRST, LAST, LIMITS, REPLY, Channel, WireError
from prismstereo_hw.errors import PrismStereoError

__all__ = ["DeviceIdentity", "FrameSource", "ProducedFrame", "Service", "ServiceStatistics"]

logger = logging.getLogger(__name__)

_HEALTH_PERIOD_S = 1.0
_POLL_S = 0.05
_JOIN_S = 10.0


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """Who the camera is: 8 bytes for life, and a 32-bit number drawn at each start."""

    device_id: bytes
    boot_id: int

    def __post_init__(self) -> None:
        """Refuse what the wire cannot carry."""
        if len(self.device_id) != 8 or not 0 <= self.boot_id <= 0xFFFF_FFFF:
            raise WireError(
                f"device id {self.device_id.hex()}, boot id {self.boot_id}: the one has 8 bytes, the other 32 bits"
            )


@dataclass(frozen=True, slots=True)
class ServiceStatistics:
    """Frames `captured`, `sent` whole and `dropped`; `sessions` begun; messages not understood; packets received."""

    captured: int
    sent: int
    dropped: int
    sessions: int
    ignored: int
    line: LineStatistics


class Service:
    """Serves one source on one link until it is stopped; the link stays the caller's to close, after `stop`.

    `calibration` are the flash bytes that a host may read (empty: none). `temperature_c` is asked once a second.
    """

    def __init__(
        self,
        source: FrameSource,
        link: Link,
        identity: DeviceIdentity,
        calibration: bytes = b"",
        *,
        lossless: bool = False,
        temperature_c: Callable[[], float | None] = lambda: None,
    ) -> None:
        if len(calibration) > LIMITS.calibration:
            raise WireError(f"a calibration of {len(calibration)} bytes: at most {LIMITS.calibration} can be kept")
        self._source = source
        self._link = link
        self._identity = identity
        self._calibration = calibration
        self._calibration_hash = calibration_hash(calibration)
        self._temperature_c = temperature_c
        self._started_us = _clock_us()
        self._stopping = threading.Event()
        self._deframer = Deframer()
        self._transmitter = Transmitter(link, self._calibration_hash, self._stopping, lossless=lossless)
        self._health_due_s = 0.0
        self._end = HealthFlag.NONE
        self._failure: PrismStereoError | None = None
        self._captured = self._sessions = self._ignored = 0
        self._threads = [
            threading.Thread(target=work, name=f"prismstereo-{work.__name__.strip('_')}", daemon=True)
            for work in (self._compute, self._listen, self._transmit)
        ]

    def start(self) -> None:
        """Begin to serve, in the background."""
        for thread in self._threads:
            thread.start()

    def run(self) -> None:
        """Serve until `stop` is called in another thread or a signal handler; raises what made the link fail."""
        self.start()
        self._stopping.wait()
        self.stop()
        if self._failure is not None:
            raise self._failure

    def stop(self) -> None:
        """End every thread; waits for the frame that the source is at, for 10 s at most."""
        self._stopping.set()
        self._transmitter.wake()
        for thread in self._threads:
            if thread.ident is not None and thread is not threading.current_thread():
                thread.join(_JOIN_S)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def failure(self) -> PrismStereoError | None:
        """What ended the service or its source, if anything did."""
        return self._failure

    @property
    def ended(self) -> bool:
        """Whether the source has ended and its last frame is on the line."""
        return self._transmitter.drained

    @property
    def statistics(self) -> ServiceStatistics:
        """The counters so far."""
        return ServiceStatistics(
            captured=self._captured,
            sent=self._transmitter.sent,
            dropped=self._transmitter.dropped,
            sessions=self._sessions,
            ignored=self._ignored,
            line=self._deframer.statistics,
        )

    def _compute(self) -> None:
        end = HealthFlag.END_OF_STREAM | HealthFlag.SOURCE_FAILED
        try:
            while not self._stopping.is_set():
                frame = self._source.read()
                if frame is None:
                    end = HealthFlag.END_OF_STREAM
                    break
                self._captured += 1
                self._transmitter.offer(frame)
        except PrismStereoError as error:
            logger.exception("the source failed after %d frames", self._captured)
            self._failure = self._failure or error
        finally:
            self._end = end
            self._transmitter.finish()

    def _transmit(self) -> None:
        try:
            self._transmitter.run()
        except PrismStereoError as error:
            logger.info("the service ends: %s", error)
            self._failure = self._failure or error
        finally:
            self._stopping.set()

    def _listen(self) -> None:
        told_end = False
        try:
            while not self._stopping.is_set():
                for packet in self._deframer.feed(self._link.read(_POLL_S)):
                    self._handle(packet)
                ended = self._transmitter.drained
                if time.monotonic() >= self._health_due_s or ended is not told_end:
                    told_end = ended
                    self._health_due_s = time.monotonic() + _HEALTH_PERIOD_S
                    self._post_health()
        except PrismStereoError as error:
            logger.info("the service ends: %s", error)
            self._failure = self._failure or error
        finally:
            self._stopping.set()
            self._transmitter.wake()

    def _handle(self, packet: Packet) -> None:
        if packet.channel != Channel.HELLO:
            self._transmitter.session.hear(time.monotonic())
        try:
            match packet.channel:
                case Channel.HELLO:
                    self._meet(packet)
                case Channel.CTRL:
                    self._control(packet)
                case Channel.BULK:
                    self._bulk(packet)
                case _:
                    self._ignored += 1
        except WireError as error:
            logger.debug("ignored: %s", error)
            self._ignored += 1

    def _meet(self, packet: Packet) -> None:
        hello = read_hello(packet.payload)
        if not isinstance(hello, Hello) or hello.kind is not HelloKind.OFFER:
            raise WireError("an answer to a hello that this end did not send")
        version = hello.shared_version()
        if version is None:
            logger.warning("a host speaks versions %d..%d only", hello.version_min, hello.version_max)
            refusal = Hello(hello.nonce, kind=HelloKind.REFUSE)
            self._post(Channel.HELLO, refusal.pack, packet)
            return
        if hello.nonce != self._transmitter.session.nonce:
            self._sessions += 1
            self._deframer.adopt(hello.nonce)
            self._transmitter.adopt(Session(hello.nonce, time.monotonic()))
            self._health_due_s = 0.0
        reply = HelloReply(
            version=version,
            nonce=hello.nonce,
            mtu=self._link.mtu,
            device_id=self._identity.device_id,
            boot_id=self._identity.boot_id,
            calibration_hash=self._calibration_hash,
        )
        self._post(Channel.HELLO, reply.pack, packet)

    def _control(self, packet: Packet) -> None:
        match read_control(packet.payload):
            case FrameAck() as ack:
                self._transmitter.session.acknowledge(ack)
                self._transmitter.wake()
            case Ping(t_host_us):
                arrived_us = _clock_us()
                self._post(Channel.CTRL, lambda: Pong(t_host_us, arrived_us, _clock_us()).pack(), packet)
            case _:
                self._ignored += 1  # a pong: this end sends no pings

    def _bulk(self, packet: Packet) -> None:
        request = ReadRequest.unpack(packet.payload)
        content = self._calibration if request.obj == CALIBRATION and self._calibration else None
        version = int.from_bytes(self._calibration_hash[:4], "little")
        answer = answer_read(request, content, version, self._link.mtu)
        self._post(Channel.BULK, answer.pack, packet)

    def _post(self, channel: Channel, body: Callable[[], bytes], request: Packet) -> None:
        session = self._transmitter.session
        self._transmitter.post(Reply(session, channel, body, FIRST | LAST | REPLY, request.msg))

    def _post_health(self) -> None:
        session = self._transmitter.session
        if session.alive(time.monotonic()):
            flags = self._end if self._transmitter.drained else HealthFlag.NONE
            self._transmitter.post(Reply(session, Channel.HEALTH, partial(self._health, flags)))

    def _health(self, flags: HealthFlag) -> bytes:
        line = self._deframer.statistics
        return Health(
            frames_captured=self._captured,
            frames_sent=self._transmitter.sent,
            frames_dropped=self._transmitter.dropped,
            packets_good=line.good,
            packets_bad=line.bad,
            packets_oversize=line.oversize,
            uptime_us=_clock_us() - self._started_us,
            temperature_c=self._temperature_c(),
            flags=flags,
        ).pack()


def _clock_us() -> int:
    return time.monotonic_ns() // 1000
