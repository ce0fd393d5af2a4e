"""An OAK camera as a sensor: whole frames in, our own matcher behind them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from types import ModuleType

from prismstereo_device.sensors.base import Exposure, Sensor, StampQuality, Still
from prismstereo_device.sensors.oak.control import CameraControls, control_limits
from prismstereo_device.sensors.oak.frame_queue import FrameQueue
from prismstereo_device.sensors.oak.frame_reading import OutputPlace, raw_frame, timestamp_us
from prismstereo_device.sensors.oak.graph import CapturePorts
from prismstereo_device.sensors.oak.opening import Running
from prismstereo_device.sensors.oak.options import OakOptions
from prismstereo_device.sensors.oak.thinning import Thinning
from prismstereo_hw.errors import DeviceError, ImageError, UsageError
from prismstereo_hw.frame import RawFrame

__all__ = ["OakCapture"]

_STILL_WAIT = timedelta(seconds=5)
_MOST_DAMAGED = 100


class OakCapture(Sensor):
    """Frames of an OAK camera, stamped at mid-exposure, with its lens locked, and stills through a gate.

    `begin` opens the camera and starts the capture graph; it is called again when the camera went away. An exposure without a
    gain, or the other way round, keeps the half that was not given as it is. A lower rate leaves frames out. `damaged` counts
    frames that could not be read.
    """

    stamp_quality = StampQuality.EXPOSURE

    def __init__(
        self,
        dai: ModuleType,
        begin: Callable[[], Running[CapturePorts]],
        options: OakOptions,
        *,
        frames: int | None = None,
        patience_s: float = 30.0,
        silent_s: float = 5.0,
    ) -> None:
        self._dai, self._left = dai, frames
        self.damaged = self._damaged_in_a_row = 0
        self._thinning = Thinning(options.rate_hz)
        self._place: OutputPlace | None = None
        self._sensor_c: float | None = None
        self._queue = FrameQueue(dai, begin, lambda ports: ports.frames, patience_s=patience_s, silent_s=silent_s)
        camera = self._queue.running.camera
        self.rig = options.rig
        self.modes = camera.modes
        self.limits = control_limits(options.rate_hz, has_motor=camera.has_motor)
        self._controls = CameraControls(dai, self.limits, lambda: self._queue.running.ports.control)

    @property
    def place(self) -> OutputPlace | None:
        """Which part of the sensor the video frames show; None before the first one."""
        return self._place

    @property
    def temperature_c(self) -> float | None:
        """The image sensor's temperature where it tells it, else the chip's."""
        return self._queue.running.chip_c() if self._sensor_c is None else self._sensor_c

    def read(self) -> RawFrame | None:
        """Wait for the next frame; None after the last. `DeviceError` when the camera does not come back."""
        while self._left is None or self._left > 0:
            message, index = self._queue.next(self._controls.again)
            if not self._thinning.keeps(timestamp_us(self._dai, message)):
                continue
            try:
                frame = raw_frame(self._dai, message, index, tells_lens=self._queue.running.camera.has_motor)
            except ImageError as error:
                self._count(error)
                continue
            self._damaged_in_a_row = 0
            self._controls.notice(message)
            self._sensor_c = message.getSensorTemperature()
            self._place = OutputPlace.of(self._dai, message)
            if self._left is not None:
                self._left -= 1
            return frame
        return None

    def _count(self, error: ImageError) -> None:
        self.damaged += 1
        self._damaged_in_a_row += 1
        if self._damaged_in_a_row >= _MOST_DAMAGED:
            raise DeviceError(f"the OAK camera gave {_MOST_DAMAGED} damaged frames in a row: {error}") from error

    def set_exposure(self, exposure: Exposure) -> None:
        """Expose so from one of the next frames on; `UsageError` beyond the limits."""
        self._controls.set_exposure(exposure)

    def set_rate(self, rate_hz: float) -> None:
        """Give so many frames a second, at most the rate that the camera was opened with."""
        limit = self.limits.rate_hz
        if limit is None or not limit.least <= rate_hz <= limit.most:
            raise UsageError(
                f"a rate of {rate_hz:g} Hz: give up to the rate that the camera was opened with, rate=HZ in its name"
            )
        self._thinning = Thinning(rate_hz)

    def set_lens(self, lens_position: int) -> None:
        """Drive the lens there and hold it; `UsageError` for a lens without a motor."""
        self._controls.set_lens(lens_position)

    def still(self) -> Still:
        """Open the gate for one full-resolution frame; it has the number of the video frame of the same exposure."""
        ports = self._queue.running.ports
        if ports.gate is None or ports.stills is None:
            raise UsageError("this camera was opened without stills: leave stills=0 away")
        try:
            ports.stills.tryGetAll()  # one that came too late for an earlier request
            ports.gate.send(self._dai.GateControl.openGate(1))
            message = ports.stills.get(_STILL_WAIT)
        except (self._dai.MessageQueue.QueueException, RuntimeError) as error:
            raise DeviceError(
                f"the OAK camera went away while it took a still: {error}: ask again when it is back"
            ) from error
        if message is None:
            raise DeviceError("the OAK camera gave no still within 5 s: ask again, or try a lower rate")
        frame = raw_frame(
            self._dai, message, self._queue.number(message), tells_lens=self._queue.running.camera.has_motor
        )
        return Still(frame, OutputPlace.of(self._dai, message).whole_crop)

    def close(self) -> None:
        """Stop the camera."""
        self._queue.close()
