"""Cameras behind Video4Linux: UVC and CSI cameras, and HDMI grabbers that carry a DSLR's live output.

OpenCV streams the buffers as they are, and only those are decoded that somebody reads. Modes and controls are asked of the
kernel directly. A stamp is the driver's: some drivers take it when a frame begins to arrive, most when it is complete;
OpenCV does not say which, so half the exposure is not taken off.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

import cv2
from cv2.typing import MatLike

from prismstereo_device.sensors.base import Exposure, Limit, SensorLimits, SensorMode
from prismstereo_device.sensors.capture import Capture
from prismstereo_device.sensors.captured import CapturedSensor
from prismstereo_device.sensors.options import Options
from prismstereo_device.sensors.pixel_formats import PIXEL_FORMATS, pixels
from prismstereo_device.sensors.v4l2_mode import chosen_mode
from prismstereo_device.sensors.v4l2_node import CameraControl, VideoNode
from prismstereo_device.sensors.wishes import require_within
from prismstereo_hw.errors import DeviceError, UsageError

__all__ = ["V4l2Sensor"]

logger = logging.getLogger(__name__)

_OPTIONS = ("width", "height", "format", "rate", "exposure_us", "gain", "lens_position", "colour", "rig")
_SILENCE_S = 3.0
_EXPOSURE_UNIT_US = 100
_MANUAL, _SHUTTER_OPEN = 1, (3, 0)  # of EXPOSURE_AUTO: manual; automatic with a fixed aperture, or all automatic
_RATE_TOLERANCE = 0.05


class V4l2Sensor(CapturedSensor):
    """A video device. `exposure_us` moves in steps of 100; `gain` is the driver's own number, as V4L2 tells no unit.

    Autofocus is switched off where there is one, and the lens position stamped on every frame.
    """

    def __init__(
        self,
        node: VideoNode,
        open_capture: Callable[[], Capture],
        options: Options,
        *,
        frames: int | None = None,
        rate_hz: float | None = None,
    ) -> None:
        self._node, self._open_capture = node, open_capture
        self._lens: int | None = None
        self._colour = options.flag("colour", default=True)
        rig = options.rig()
        self.modes = node.modes()
        self._mode = chosen_mode(self.modes, options, None if rig is None else rig.camera.video)
        capture = self._configured()
        try:
            self._lock_lens(options.whole("lens_position", 0))
            self.set_exposure(Exposure(options.number("exposure_us"), options.number("gain")))
        except BaseException:
            capture.release()
            raise
        super().__init__(capture, node.path, rig=rig, timeout_s=_SILENCE_S, frames=frames, rate_hz=rate_hz)

    @classmethod
    def parse(cls, argument: str, *, frames: int | None = None, rate_hz: float | None = None) -> V4l2Sensor:
        """Open `/dev/video0[?width=1280&height=720&format=MJPG&rate=30&exposure_us=8000&gain=16&rig=oak-1]`.

        A number alone is short for that video device. `/dev/v4l/by-id/...` finds a camera again in whatever port it is.
        """
        name, options = Options.behind(argument, _OPTIONS)
        path = f"/dev/video{name}" if name.isascii() and name.isdigit() else name
        node = VideoNode.open(path)
        try:
            return cls(node, lambda: _opened(path), options, frames=frames, rate_hz=rate_hz)
        except BaseException:
            node.close()
            raise

    @property
    def mode(self) -> SensorMode:
        """The mode that the camera runs in."""
        return self._mode

    def set_exposure(self, exposure: Exposure) -> None:
        """Expose so; `UsageError` where the camera cannot, not so far, or its driver does not obey."""
        limits = self.limits
        if exposure.exposure_us is not None:
            require_within("exposure_us", exposure.exposure_us, limits.exposure_us)
        if exposure.gain is not None:
            require_within("gain", exposure.gain, limits.gain)
        if self._node.limit(CameraControl.EXPOSURE_AUTO_PRIORITY) is not None:
            self._node.set(CameraControl.EXPOSURE_AUTO_PRIORITY, 0)  # dark is better than half the frames
        if exposure.exposure_us is None:
            self._leave_exposure_to_the_camera()
        else:
            if self._node.limit(CameraControl.EXPOSURE_AUTO) is not None:
                self._obeyed(CameraControl.EXPOSURE_AUTO, _MANUAL)
            self._obeyed(CameraControl.EXPOSURE_ABSOLUTE, round(exposure.exposure_us / _EXPOSURE_UNIT_US))
        if self._node.limit(CameraControl.AUTO_GAIN) is not None:
            self._obeyed(CameraControl.AUTO_GAIN, int(exposure.gain is None))
        if exposure.gain is not None:
            self._obeyed(CameraControl.GAIN, round(exposure.gain))

    def set_rate(self, rate_hz: float) -> None:
        """Give so many frames a second: the stream stops for it and starts again, its frame numbers go on."""
        if self.limits.rate_hz is not None:
            require_within("rate_hz", rate_hz, self.limits.rate_hz)
        before, self._mode = self._mode, SensorMode(*self._mode_key(), rate_hz=rate_hz)
        self._thread.close()
        try:
            capture = self._configured()
        except UsageError:
            self._mode = before
            self._start_again(self._configured())
            raise
        self._start_again(capture)

    def set_lens(self, lens_position: int) -> None:
        """Drive the lens there and hold it; `UsageError` where there is no motor, or it does not go that far."""
        require_within("lens_position", lens_position, self.limits.lens_position)
        self._lock_lens(lens_position)

    def close(self) -> None:
        """Let go of the camera."""
        super().close()
        self._node.close()

    @property
    def _lens_position(self) -> int | None:
        return self._lens

    def _pixels(self, content: MatLike) -> MatLike:
        if content.ndim == 3 or min(content.shape) > 1:  # a backend that decodes, whatever it was told
            return content
        size = self._mode.width, self._mode.height
        return pixels(content, self._mode.pixel_format, size, colour=self._colour)

    def _mode_key(self) -> tuple[int, int, str]:
        return self._mode.width, self._mode.height, self._mode.pixel_format

    def _configured(self) -> Capture:
        """Open the stream in the wished mode; `UsageError` where the driver gives another one."""
        capture = self._open_capture()
        try:
            self._configure(capture)
        except BaseException:
            capture.release()
            raise
        return capture

    def _configure(self, capture: Capture) -> None:
        width, height, pixel_format = self._mode_key()
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*pixel_format))
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
        if self._mode.rate_hz:
            capture.set(cv2.CAP_PROP_FPS, self._mode.rate_hz)
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        got = round(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if got != (width, height):
            raise UsageError(
                f"the camera {self._node.path} gives {got[0]}x{got[1]} pixels where {width}x{height} were asked for: "
                "give a size that it has"
            )
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        if self._mode.rate_hz and abs(rate_hz - self._mode.rate_hz) > _RATE_TOLERANCE * self._mode.rate_hz:
            raise UsageError(
                f"the camera {self._node.path} runs at {rate_hz:g} Hz where {self._mode.rate_hz:g} were asked for: "
                "give a rate that it has in this size and format"
            )
        self.limits = self._measured_limits()

    def _measured_limits(self) -> SensorLimits:
        exposure = self._node.limit(CameraControl.EXPOSURE_ABSOLUTE)
        key = self._mode_key()
        rates_hz = [
            mode.rate_hz
            for mode in self.modes
            if (mode.width, mode.height, mode.pixel_format) == key and mode.rate_hz > 0
        ]
        return SensorLimits(
            exposure_us=exposure and Limit(exposure.least * _EXPOSURE_UNIT_US, exposure.most * _EXPOSURE_UNIT_US),
            gain=self._node.limit(CameraControl.GAIN),
            rate_hz=Limit(min(rates_hz), max(rates_hz)) if rates_hz else None,
            lens_position=self._node.limit(CameraControl.FOCUS_ABSOLUTE),
        )

    def _leave_exposure_to_the_camera(self) -> None:
        if self._node.limit(CameraControl.EXPOSURE_AUTO) is None:
            return
        for value in _SHUTTER_OPEN:  # UVC cameras know the first, others the second
            try:
                self._node.set(CameraControl.EXPOSURE_AUTO, value)
            except UsageError:
                continue
            return
        logger.warning("the camera %s has no automatic exposure", self._node.path)

    def _lock_lens(self, lens_position: int | None) -> None:
        """Hold the lens still: a calibration belongs to one position."""
        if self._node.limit(CameraControl.FOCUS_AUTO) is not None:
            self._obeyed(CameraControl.FOCUS_AUTO, 0)
        limit = self._node.limit(CameraControl.FOCUS_ABSOLUTE)
        if lens_position is not None:
            require_within("lens_position", lens_position, limit)
            self._obeyed(CameraControl.FOCUS_ABSOLUTE, lens_position)
        self._lens = None if limit is None else self._node.get(CameraControl.FOCUS_ABSOLUTE)

    def _obeyed(self, control: CameraControl, value: int) -> None:
        """Set a control and read it back: some drivers say yes and do nothing."""
        got = self._node.set(control, value)
        if got != value:
            raise UsageError(
                f"the camera {self._node.path} makes {got} of {control.name} {value}: give a value that its driver keeps"
            )


def _opened(path: str) -> Capture:
    capture = cv2.VideoCapture(path, cv2.CAP_V4L2)
    if not capture.isOpened():
        capture.release()
        raise DeviceError(
            f"cannot stream from the camera {path}: another program may have it, or its pixel format is none of "
            f"{', '.join(PIXEL_FORMATS)}"
        )
    return capture
