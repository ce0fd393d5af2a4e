"""The camera's service: frames of a source to whichever host says hello.

Four threads: one computes (it sits in the source), one listens and keeps the pulse, one writes, one reads and writes objects. A
source that computes for seconds, or a calibration that takes long to store, so delays no answer and no heartbeat. The newest
frame wins: what the line has no room for is dropped before it is compressed, and counted. A *lossless* service makes the source
wait instead.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from functools import partial
from types import TracebackType
from typing import Self

from prismstereo_device.framing import Deframer, Packet
from prismstereo_device.link import Link
from prismstereo_device.objects import Objects
from prismstereo_device.protocol.control import FrameAck, Ping, Pong, read_control
from prismstereo_device.protocol.health import HealthFlag
from prismstereo_device.protocol.hello import Capability, Hello, HelloKind, HelloReply, read_hello
from prismstereo_device.serving.answers import BulkAnswers, Commands, NoCommands, answer_command
from prismstereo_device.serving.device_identity import DeviceIdentity
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.pulse import Pulse, ServiceStatistics
from prismstereo_device.serving.rate_control import RateControl, warm_up
from prismstereo_device.serving.session import Session
from prismstereo_device.serving.status_led import LedState, NoLed, StatusLed
from prismstereo_device.serving.transmitter import Reply, Transmitter
from prismstereo_device.serving.watchdog import Notifier
from prismstereo_device.source import FrameSource, ProducedFrame
from prismstereo_device.wire import FIRST, LAST, REPLY, Channel, WireError
from prismstereo_hw.errors import PrismStereoError

__all__ = ["DeviceIdentity", "FrameSource", "ProducedFrame", "Service", "ServiceStatistics"]

logger = logging.getLogger(__name__)

_POLL_S = 0.05
_JOIN_S = 10.0
_KICK_S = 0.5


class Service:
    """Serves one source on one link until it is stopped; the link stays the caller's to close, after `stop`.

    `objects` are what a host reads and writes by number, `commands` what runs its commands; without them there is nothing to
    read, and no command is known. `rate_control` decides how fine frames are; without one they are exact. `offers` is what
    the source can be asked for. Once a second `temperature_c` and `last_error` are asked. `clock_us` is the device's own
    monotonic clock, which stamps the frames too.
    """

    def __init__(
        self,
        source: FrameSource,
        link: Link,
        identity: DeviceIdentity,
        *,
        objects: Objects | None = None,
        commands: Commands | None = None,
        rate_control: RateControl | None = None,
        lossless: bool = False,
        offers: Capability = Capability.NONE,
        temperature_c: Callable[[], float | None] = lambda: None,
        last_error: Callable[[], str] = lambda: "",
        notifier: Notifier | None = None,
        led: StatusLed | None = None,
        clock_us: Callable[[], int] = lambda: time.monotonic_ns() // 1000,
    ) -> None:
        self._source = source
        self._link = link
        self._identity = identity
        self._commands = NoCommands() if commands is None else commands
        self._offers = Capability.COMPACT | offers | (Capability.NONE if commands is None else Capability.COMMANDS)
        self._rate_control = RateControl(bound=0) if rate_control is None else rate_control
        self._notifier = Notifier() if notifier is None else notifier
        self._clock_us = clock_us
        self._stopping = threading.Event()
        self._deframer = Deframer()
        self._transmitter = Transmitter(link, self._rate_control, self._stopping, lossless=lossless)
        self._bulk = BulkAnswers(FixedObjects() if objects is None else objects, link.mtu, self._post_bulk)
        self._end = HealthFlag.NONE
        self._failure: PrismStereoError | None = None
        self._captured = self._sessions = self._ignored = 0
        self._pulse = Pulse(clock_us, temperature_c, last_error)
        self._led = NoLed() if led is None else led
        self._threads = [
            threading.Thread(target=work, name=f"prismstereo-{work.__name__.strip('_')}", daemon=True)
            for work in (self._compute, self._listen, self._transmit)
        ]

    def start(self) -> None:
        """Begin to serve, in the background."""
        self._led.show(LedState.STARTING)
        self._bulk.start()
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
        self._notifier.stopping()
        self._transmitter.wake()
        self._bulk.stop()
        for thread in self._threads:
            if thread.ident is not None and thread is not threading.current_thread():
                thread.join(_JOIN_S)
        self._led.show(LedState.OFF if self._failure is None else LedState.FAULT)

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
            pictures_dropped=self._transmitter.pictures_dropped,
            sessions=self._sessions,
            ignored=self._ignored,
            line=self._deframer.statistics,
        )

    def _compute(self) -> None:
        end = HealthFlag.END_OF_STREAM | HealthFlag.SOURCE_FAILED
        try:
            warm_up()
            while not self._stopping.is_set():
                frame = self._source.read()
                self._notifier.ready()
                if frame is None:
                    end = HealthFlag.END_OF_STREAM
                    break
                self._captured += 1
                self._notifier.kick()
                self._transmitter.offer(frame, self._notifier.kick)
        except PrismStereoError as error:
            logger.exception("the source failed after %d frames", self._captured)
            self._failure = self._failure or error
        finally:
            self._end = end
            self._transmitter.finish()
        while end is HealthFlag.END_OF_STREAM and not self._stopping.wait(_KICK_S):
            self._notifier.kick()  # all is well, there is only nothing left to do

    def _transmit(self) -> None:
        try:
            self._transmitter.run()
        except PrismStereoError as error:
            self._fail(error)
        finally:
            self._stopping.set()

    def _listen(self) -> None:
        try:
            while not self._stopping.is_set():
                for packet in self._deframer.feed(self._link.read(_POLL_S)):
                    self._handle(packet)
                self._show()
        except PrismStereoError as error:
            self._fail(error)
        finally:
            self._stopping.set()
            self._transmitter.wake()

    def _fail(self, error: PrismStereoError) -> None:
        logger.info("the service ends: %s", error)
        self._failure = self._failure or error

    def _handle(self, packet: Packet) -> None:
        session = self._transmitter.session
        if packet.channel != Channel.HELLO:
            session.hear(time.monotonic())
        try:
            match packet.channel:
                case Channel.HELLO:
                    self._meet(packet)
                case Channel.CTRL:
                    self._control(packet, session)
                case Channel.CMD:
                    body = answer_command(packet, session, self._commands)
                    if body is not None:
                        self._post(session, Channel.CMD, lambda: body, packet.msg)
                case Channel.BULK:
                    self._bulk.ask(packet, session)
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
            self._post(self._transmitter.session, Channel.HELLO, refusal.pack, packet.msg)
            return
        if hello.nonce != self._transmitter.session.nonce:
            self._begin_session(hello)
        reply = HelloReply(
            version=version,
            nonce=hello.nonce,
            mtu=self._link.mtu,
            device_id=self._identity.device_id,
            boot_id=self._identity.boot_id,
            calibration_hash=self._bulk.calibration_hash,
            capabilities=self._offers,
        )
        self._post(self._transmitter.session, Channel.HELLO, reply.pack, packet.msg)

    def _begin_session(self, hello: Hello) -> None:
        """Serve this host from now on; nothing of the host before is left."""
        self._sessions += 1
        self._deframer.adopt(hello.nonce)
        reads_compact = Capability.COMPACT in hello.capabilities
        self._transmitter.adopt(Session(hello.nonce, time.monotonic(), compact=reads_compact))
        self._bulk.end_session()
        self._pulse.hurry()
        logger.info("session %d begins", self._sessions)

    def _control(self, packet: Packet, session: Session) -> None:
        match read_control(packet.payload):
            case FrameAck() as ack:
                session.acknowledge(ack)
                self._transmitter.wake()
            case Ping(t_host_us):
                arrived_us = self._clock_us()
                self._post(
                    session, Channel.CTRL, lambda: Pong(t_host_us, arrived_us, self._clock_us()).pack(), packet.msg
                )
            case _:
                self._ignored += 1  # a pong: this end sends no pings

    def _post(self, session: Session, channel: Channel, body: Callable[[], bytes], msg: int) -> None:
        self._transmitter.post(Reply(session, channel, body, FIRST | LAST | REPLY, msg))

    def _post_bulk(self, session: Session, body: bytes, msg: int) -> None:
        self._post(session, Channel.BULK, lambda: body, msg)

    def _show(self) -> None:
        """Tell the host, once a second and at the end, how things are; and always the lamp and the service manager."""
        now_s, session, drained = time.monotonic(), self._transmitter.session, self._transmitter.drained
        alive = session.alive(now_s)
        if self._pulse.due(now_s, drained) and alive:
            flags = self._end if drained else HealthFlag.NONE
            self._transmitter.post(Reply(session, Channel.HEALTH, partial(self._health, session, flags)))
        if self._failure is not None:
            self._led.show(LedState.FAULT)
            self._notifier.status(f"failed: {self._failure}")
        elif not self._captured:
            self._notifier.status("waiting for the first frame")
        else:
            self._led.show(LedState.STREAMING if alive else LedState.WAITING)
            self._notifier.status("a host is served" if alive else f"waiting for a host on {self._link.name}")

    def _health(self, session: Session, flags: HealthFlag) -> bytes:
        mode = self._rate_control.mode if session.compact else None
        written_bytes = self._transmitter.written_bytes
        return self._pulse.report(self.statistics, mode, written_bytes, flags, str(self._failure or "")).pack()
