"""The sensor from the desk: open it, iterate over its frames, ask for its calibration.

    with prismstereo.open("/dev/ttyACM0") as camera:
        for frame in camera:
            print(frame.age_us, frame.depth_mm)

Two threads work behind it: one reads, one keeps the session alive, so a slow `for` loop loses frames (counted) but never
the sensor. A sensor that was pulled out, or has started anew, is searched for, and the iteration goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Self, cast, overload

from prismstereo.camera_controls import CameraControls
from prismstereo.camera_frame import CameraFrame
from prismstereo.camera_statistics import CameraStatistics
from prismstereo.clock import ClockMapping
from prismstereo.connection import Connection
from prismstereo.events import CameraEvent, CameraState
from prismstereo.frame_calls import FrameCalls
from prismstereo.frame_pictures import FramePictures
from prismstereo.held_calibration import HeldCalibration
from prismstereo.inbox import Inbox, Stream
from prismstereo.meeting import CameraIdentity
from prismstereo.reception import Reception
from prismstereo.transfer import ObjectTransfer
from prismstereo_device.framing import Packet
from prismstereo_device.link import Link, open_link
from prismstereo_device.protocol import Health, ReceivedFrame, ReceivedPicture, calibration_hash
from prismstereo_device.wire import Channel
from prismstereo_device.zones import ZoneDistances
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.rectification import Rectification
    from prismstereo_calibration.window import DisparityWindow

__all__ = ["CameraFrame", "CameraIdentity", "CameraStatistics", "StereoCamera"]

_REOPEN_S = 1.0
_NEWEST = 4
PictureChannel = Literal[Channel.IMG, Channel.RAW, Channel.REASON, Channel.CONFIDENCE]
_STREAMS = (Channel.IMG, Channel.RAW, Channel.REASON, Channel.CONFIDENCE, Channel.ZONES, Channel.HEALTH)


class StereoCamera(CameraControls):
    """A session with one sensor after the other; owns its link.

    Raises LinkLost when nothing answers, DeviceError when the versions do not meet. Iteration ends in good order when the
    camera says that its stream has ended. With `reopen` a link that is lost, silent for `silence_s`, or whose camera has
    started anew is opened and met again, and the iteration goes on after the gap; without it the iteration then raises
    LinkLost, after the frames so far. `queue_frames` frames wait for a slow reader, then the oldest is dropped; `keep_all`
    makes the camera wait instead. `after_close` is called once, when all is closed.
    """

    def __init__(
        self,
        link: Link,
        timeout_s: float = 5.0,
        *,
        silence_s: float = 3.0,
        queue_frames: int = 8,
        keep_all: bool = False,
        reopen: Callable[[], Link] | None = None,
        after_close: Callable[[], None] | None = None,
    ) -> None:
        connection = Connection(link, timeout_s, silence_s=silence_s, reopen=reopen)
        self._connection = connection
        self._reception = Reception(connection, Inbox(queue_frames, keep_all=keep_all), self)
        transfer = ObjectTransfer(self._reception.bulk, lambda: connection.identity.mtu, link.name)
        super().__init__(self._reception.commands, transfer, lambda: connection.identity, link.name)
        self._calibrations = HeldCalibration(transfer, link.name)
        self._written: tuple[CameraIdentity, bytes] | None = None
        self._after_close = after_close
        self._calls: list[FrameCalls] = []
        connection.start(self._reception)

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
        reconnect: bool = True,
    ) -> Self:
        """Open the sensor at a serial port (`/dev/ttyACM0`, `COM3`) or at `tcp:HOST:PORT`.

        With `reconnect` it is searched for there when it is lost. Raises PortError where there is nothing to open, and
        otherwise as the constructor does.
        """
        link = open_link(port, baud=baud, timeout_s=timeout_s)
        try:
            return cls(
                link,
                timeout_s,
                silence_s=silence_s,
                queue_frames=queue_frames,
                keep_all=keep_all,
                reopen=(lambda: open_link(port, baud=baud, timeout_s=_REOPEN_S)) if reconnect else None,
            )
        except BaseException:
            link.close()
            raise

    def __iter__(self) -> Iterator[CameraFrame]:
        while (frame := self.take()) is not None:
            yield frame

    def take(self, timeout_s: float | None = None) -> CameraFrame | None:
        """Wait for the next frame, as an iteration does; None when the time is over, or where the stream has ended."""
        frame = self._reception.inbox.take(timeout_s)
        if frame is not None:
            self._reception.taken()
        return frame

    def frames(self, newest: int = 1) -> Stream[CameraFrame]:
        """Iterate over the frames from now on beside all other readers; the `newest` so many wait for a slow one."""
        return cast("Stream[CameraFrame]", self._reception.stream(Channel.DISP, newest))

    def on_frame(self, call: Callable[[CameraFrame], object], newest: int = 1) -> FrameCalls:
        """Call `call(frame)` with every frame from now on, in a thread of its own, which may ask the camera anything.

        While it works, the `newest` so many wait and older ones are dropped. It ends with the camera, by `stop()` of what is
        returned, or when `call` raises.
        """
        calls = FrameCalls(self.frames(newest), call)
        self._calls = [*(other for other in self._calls if other.running), calls]
        return calls

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the session and give the port back; closing twice does no harm."""
        self._connection.close()
        self._reception.end(None)
        for calls in self._calls:
            calls.stop()
        after_close, self._after_close = self._after_close, None
        if after_close is not None:
            after_close()

    @property
    def identity(self) -> CameraIdentity:
        """Who the camera is, as it said at the last hello."""
        return self._connection.identity

    @property
    def state(self) -> CameraState:
        """How things stand with the camera."""
        return self._connection.state

    @property
    def session(self) -> int:
        """Which session is under way; they count from 1."""
        return self._connection.counts.sessions

    @property
    def on_event(self) -> list[Callable[[CameraEvent], None]]:
        """What is called when something happens to the connection: append to it. It is called by the reading thread.

        A callback is quick, raises nothing, and asks the camera nothing.
        """
        return self._reception.on_event

    @property
    def on_packet(self) -> list[Callable[[Packet, int, int], None]]:
        """What is called with every good packet, the host's monotonic microseconds and the session's number: append to it.

        It is called by the reading thread, before anything is made of the packet; it is quick and raises nothing.
        """
        return self._reception.on_packet

    @property
    def clock(self) -> ClockMapping | None:
        """The camera's clock as seen from here, and how far that can be off; None before it has answered a probe.

        It takes the stamps of frames to `time.monotonic` in microseconds: `camera.clock.host_time_us(frame.timestamp_us)`.
        """
        return self._reception.clock

    @property
    def statistics(self) -> CameraStatistics:
        """The counters so far."""
        reception, counts = self._reception, self._connection.counts
        frames = reception.counter.counts
        return CameraStatistics(
            frames=frames.frames,
            partial=frames.partial,
            lost=frames.lost,
            not_taken=reception.inbox.not_taken,
            malformed=reception.malformed,
            line=self._connection.line,
            round_trip_us=reception.round_trip_us,
            health=reception.health,
            sessions=counts.sessions,
            reboots=counts.reboots,
            replugs=counts.replugs,
            repeated=reception.commands.repeated + reception.bulk.repeated,
        )

    @property
    def pictures(self) -> FramePictures:
        """What lately arrived beside the frames; a frame finds its own there."""
        return self._reception.frame_pictures

    @overload
    def stream(self, channel: PictureChannel, newest: int = _NEWEST) -> Stream[ReceivedPicture]: ...
    @overload
    def stream(self, channel: Literal[Channel.ZONES], newest: int = _NEWEST) -> Stream[ZoneDistances]: ...
    @overload
    def stream(self, channel: Literal[Channel.HEALTH], newest: int = _NEWEST) -> Stream[Health]: ...
    def stream(
        self, channel: Channel, newest: int = _NEWEST
    ) -> Stream[ReceivedPicture] | Stream[ZoneDistances] | Stream[Health]:
        """Iterate over what arrives on a channel beside the frames; the `newest` so many wait for a slow reader.

        Switch it on first: `camera.set("preview", True)` for IMG, and `raw`, `reasons`, `confidence`, `zones` alike. Raises
        UsageError for a channel that has no such stream.
        """
        if channel not in _STREAMS:
            names = ", ".join(known.name for known in _STREAMS)
            raise UsageError(f"channel {channel.name} cannot be read as a stream: {names} can")
        return cast(
            "Stream[ReceivedPicture] | Stream[ZoneDistances] | Stream[Health]", self._reception.stream(channel, newest)
        )

    @property
    def calibration_bytes(self) -> bytes:
        """The flash bytes of the calibration in use, fetched once and held against the hash that the camera gave.

        Raises LinkLost when it does not answer, DataError when it has none or its bytes do not match.
        """
        return self._calibrations.content(self._calibration_named())

    @property
    def calibration(self) -> Calibration:
        """The calibration that the camera's frames are made with; raises as `calibration_bytes`, or CalibrationError."""
        return self._calibrations.calibration(self._calibration_named())

    @property
    def window(self) -> DisparityWindow:
        """The range window of the camera's calibration, with what the glass before its lens does; fetches it."""
        from prismstereo_calibration.rectification import rectification

        return rectification(self.calibration).window

    def depth(self, frame: ReceivedFrame) -> NDArray[np.float32]:
        """Depth (height, width) of a frame along the rectified z axis in mm, glass considered; NaN where unmatched.

        The calibration is the one that the frame was made with, fetched if need be: DataError where the camera no longer
        has it, UsageError where the frame was made with none and says no scale.
        """
        return self._calibrations.window(frame).depth_map(frame.disparity.disparity_px)

    def rectification(self, frame: ReceivedFrame) -> Rectification:
        """Give the geometry of a frame's map, whatever its resolution; raises as `depth`, and DataError where it has none."""
        return self._calibrations.rectification(frame)

    def write_calibration(self, content: bytes) -> None:
        """Make these flash bytes the camera's calibration; it verifies them, and keeps the old one where it refuses them."""
        super().write_calibration(content)
        self._written = (self.identity, calibration_hash(content))

    def restore_calibration(self, *, timeout_s: float = 5.0) -> bytes:
        """Go back to the first calibration that the camera ever had, wait until it is in use, and return its flash bytes."""
        content = super().restore_calibration(timeout_s=timeout_s)
        self._written = (self.identity, calibration_hash(content))
        return content

    def _calibration_named(self) -> bytes:
        """Name the calibration in use: as the newest frame does, where that is no longer the one of the hello."""
        identity, frame_hash = self.identity, self._reception.frame_hash
        named = identity.calibration_hash
        if self._written is not None and self._written[0] is identity:
            named = self._written[1]
        elif any(frame_hash) and not named.startswith(frame_hash):
            named = frame_hash
        return named
