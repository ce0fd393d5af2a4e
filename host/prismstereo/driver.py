"""The sensor from the desk: open it, iterate over its frames, ask for its calibration.

    with StereoCamera.open("/dev/ttyACM0") as camera:
        for frame in camera:
            depth_mm = camera.depth(frame)

Two threads work behind it: one reads, one keeps the session alive, so a slow `for` loop loses frames (counted) but never
the sensor.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from types import TracebackType
from typing import TYPE_CHECKING, Self

from prismstereo.inbox import Inbox
from prismstereo.meeting import CameraIdentity, meet
from prismstereo.reading import ObjectReader
from prismstereo_device.framing import LineStatistics, Packet
from prismstereo_device.link import Link, LinkLost, open_link
from prismstereo_device.protocol import (
    CALIBRATION,
    FrameAck,
    FrameAssembler,
    Health,
    HealthFlag,
    Ping,
    Pong,
    ReceivedFrame,
    calibration_hash,
    read_control,
)
from prismstereo_device.wire import FIRST, LAST, LIMITS, REPLY, Channel, WireError
from prismstereo_hw.errors import DataError, DeviceError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.window import DisparityWindow

__all__ = ["CameraIdentity", "CameraStatistics", "StereoCamera"]

_POLL_S = 0.1
_BEAT_S = 0.1
_PING_EVERY_S = 1.0
_FIRST_PINGS = 8
_WRITE_S = 0.5


@dataclass(frozen=True, slots=True)
class CameraStatistics:
    """What has happened on the line since it was opened.

    `frames` arrived, of which `partial` lack stripes; `lost` never arrived (gaps in their numbers: dropped by the camera
    or on the line); `not_taken` arrived but were pushed out before they were read. `malformed` messages came in good
    packets. `health` is the camera's last report.
    """

    frames: int
    partial: int
    lost: int
    not_taken: int
    malformed: int
    line: LineStatistics
    round_trip_us: int | None
    health: Health | None


class StereoCamera:
    """A session with one sensor; owns its link.

    Raises LinkLost when nothing answers, DeviceError when the versions do not meet. Iteration ends in good order when the
    camera says that its stream has ended, and raises LinkLost when it goes away or is silent for `silence_s`: the frames
    so far are delivered first. `queue_frames` frames wait for a slow reader, then the oldest is dropped; `keep_all` makes
    the camera wait instead.
    """

    def __init__(
        self,
        link: Link,
        timeout_s: float = 5.0,
        *,
        silence_s: float = 3.0,
        queue_frames: int = 8,
        keep_all: bool = False,
    ) -> None:
        self._link = link
        self._silence_s = silence_s
        meeting = meet(link, timeout_s)
        self.identity = meeting.identity
        self._framer, self._deframer = meeting.framer, meeting.deframer
        self._assembler = FrameAssembler()
        self._inbox = Inbox(queue_frames, keep_all=keep_all)
        self._reader = ObjectReader(self._send)
        self._sending = threading.Lock()
        self._torn = False
        self._stopping = threading.Event()
        self._beat_now = threading.Event()
        self._told: FrameAck | None = None
        self._malformed = 0
        self._round_trip_us: int | None = None
        self._health: Health | None = None
        self._calibration_bytes: bytes | None = None
        for packet in meeting.early:
            self._handle(packet)
        self._threads = [
            threading.Thread(target=work, name=f"prismstereo-{work.__name__.strip('_')}", daemon=True)
            for work in (self._listen, self._beat)
        ]
        for thread in self._threads:
            thread.start()

    @classmethod
    def open(
        cls,
        port: str,
        timeout_s: float = 5.0,
        *,
        baud: int | None = None,
        silence_s: float = 3.0,
        queue_frames: int = 8,
        keep_all: bool = False,
    ) -> Self:
        """Open the sensor at a serial port (`/dev/ttyACM0`, `COM3`) or at `tcp:HOST:PORT`.

        Raises PortError where there is nothing to open, and otherwise as the constructor does.
        """
        link = open_link(port, baud=baud, timeout_s=timeout_s)
        try:
            return cls(link, timeout_s, silence_s=silence_s, queue_frames=queue_frames, keep_all=keep_all)
        except BaseException:
            link.close()
            raise

    def __iter__(self) -> Iterator[ReceivedFrame]:
        while (frame := self._inbox.take()) is not None:
            if self._inbox.room > 0 and self._told is not None and self._told.room == 0:
                self._beat_now.set()  # the camera waits for this
            yield frame

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the session and give the port back; closing twice does no harm."""
        self._stopping.set()
        self._beat_now.set()
        for thread in self._threads:
            thread.join()
        self._inbox.end()
        self._link.close()

    @property
    def statistics(self) -> CameraStatistics:
        """The counters so far."""
        counts = self._inbox.counts
        return CameraStatistics(
            frames=counts.frames,
            partial=counts.partial,
            lost=counts.lost,
            not_taken=counts.not_taken,
            malformed=self._malformed + self._assembler.statistics.malformed,
            line=self._deframer.statistics,
            round_trip_us=self._round_trip_us,
            health=self._health,
        )

    @property
    def calibration_bytes(self) -> bytes:
        """The calibration's flash bytes, fetched once and held against the hash that the camera gave at hello.

        Raises LinkLost when it does not answer, DataError when it has none or its bytes do not match.
        """
        if self._calibration_bytes is None:
            if not any(self.identity.calibration_hash):
                raise DataError(f"the sensor on {self._link.name} holds no calibration: calibrate it, then flash it")
            data = self._reader.read(CALIBRATION, LIMITS.calibration, self._link.name)
            if calibration_hash(data) != self.identity.calibration_hash:
                raise DataError(
                    f"the calibration on {self._link.name} has hash {calibration_hash(data).hex()}, "
                    f"announced was {self.identity.calibration_hash.hex()}: open the sensor again"
                )
            self._calibration_bytes = data
        return self._calibration_bytes

    @property
    def calibration(self) -> Calibration:
        """The calibration that the camera's frames were made with; raises as `calibration_bytes`, or CalibrationError."""
        from prismstereo_calibration import flash

        return flash.unpack(self.calibration_bytes)

    @cached_property
    def window(self) -> DisparityWindow:
        """The range window of the camera's frames, with what the glass before its lens does; fetches the calibration."""
        from prismstereo_calibration.rectification import rectification

        return rectification(self.calibration).window

    def depth(self, frame: ReceivedFrame) -> NDArray[np.float32]:
        """Depth (height, width) of a frame along the rectified z axis in mm, glass considered; NaN where unmatched."""
        return self.window.depth_map(frame.disparity.disparity_px)

    def _listen(self) -> None:
        heard_at_s = time.monotonic()
        while not self._stopping.is_set():
            try:
                packets = self._deframer.feed(self._link.read(_POLL_S))
            except LinkLost as error:
                self._fail(error)
                return
            for packet in packets:
                self._handle(packet)
            started = self._assembler.newest_started
            if started is not None and (self._told is None or self._told.newest_frame != started):
                self._beat_now.set()
            now_s = time.monotonic()
            if packets:
                heard_at_s = now_s
            elif now_s - heard_at_s > self._silence_s:
                self._fail(f"nothing was heard for {self._silence_s:g} s")
                return

    def _beat(self) -> None:
        """Acknowledge and ping, on a clock of its own, so that the session outlives any slow reader."""
        pings, ping_at_s = 0, 0.0
        while not self._stopping.is_set():
            self._beat_now.clear()
            started = self._assembler.newest_started
            if started is not None:
                self._told = FrameAck(started, self._inbox.room)
                self._send(Channel.CTRL, self._told.pack())
            now_s = time.monotonic()
            if now_s >= ping_at_s:
                pings += 1
                ping_at_s = now_s + (_PING_EVERY_S if pings >= _FIRST_PINGS else 0.0)
                self._send(Channel.CTRL, Ping(_clock_us()).pack())
            self._beat_now.wait(_BEAT_S)

    def _handle(self, packet: Packet) -> None:
        try:
            match packet.channel:
                case Channel.DISP:
                    self._deliver(self._assembler.feed(packet))
                case Channel.CTRL:
                    self._control(packet)
                case Channel.HEALTH:
                    self._report(Health.unpack(packet.payload))
                case Channel.BULK:
                    self._reader.answer(packet)
        except WireError:
            self._malformed += 1

    def _deliver(self, frames: list[ReceivedFrame]) -> None:
        for frame in frames:
            self._inbox.put(frame)

    def _control(self, packet: Packet) -> None:
        match read_control(packet.payload):
            case Ping(t_host_us):
                now_us = _clock_us()
                self._send(Channel.CTRL, Pong(t_host_us, now_us, now_us).pack(), REPLY, packet.msg)
            case Pong(t_host_us, t_rx_us, t_tx_us):
                self._round_trip_us = _clock_us() - t_host_us - (t_tx_us - t_rx_us)

    def _report(self, health: Health) -> None:
        self._health = health
        if HealthFlag.END_OF_STREAM in health.flags:
            self._deliver(self._assembler.flush())
            if HealthFlag.SOURCE_FAILED not in health.flags:
                self._inbox.end()
                return
            frames = self._inbox.counts.frames
            mend = "its own log says why; restart it"
            self._inbox.end(DeviceError(f"the sensor on {self._link.name} broke after {frames} frames: {mend}"))

    def _send(self, channel: Channel, payload: bytes, flags: int = 0, msg: int = 0) -> None:
        """Write one packet; what the line has no room for is not sent, and asked for or said again later."""
        with self._sending:
            data = self._framer.encode(channel, payload, flags=flags | FIRST | LAST, msg=msg)
            if self._torn:
                data = b"\0" + data
            with contextlib.suppress(LinkLost):  # the reading side finds the same, after what is still there to read
                self._torn = self._link.write(data, _WRITE_S) < len(data)

    def _fail(self, why: object) -> None:
        """End the stream: the device is gone."""
        self._deliver(self._assembler.flush())
        self._reader.end()
        frames = self._inbox.counts.frames
        self._inbox.end(LinkLost(f"the sensor on {self._link.name} was lost after {frames} frames: {why}"))
        self._stopping.set()
        self._beat_now.set()


def _clock_us() -> int:
    return time.monotonic_ns() // 1000
