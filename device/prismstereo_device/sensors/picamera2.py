"""Raspberry Pi cameras on the CSI connector, through picamera2 and libcamera.

One configuration holds two streams of the same exposure: `lores` is the video, `main` has the same picture in as many
pixels as the sensor gives for it. Where the sensor is fast enough with all its pixels, a still is the `main` of a video
frame; where it is not, the camera changes its mode for one still and back. Both streams have the same proportions, because
the older image processors cut them out of one window and would squeeze the other one.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.sensors.base import Exposure, Limit, Pace, Sensor, SensorLimits, StampQuality, Still
from prismstereo_device.sensors.options import Options
from prismstereo_device.sensors.pi_camera import chosen_streams, listed_modes
from prismstereo_device.sensors.pi_exposure import exposure_controls
from prismstereo_device.sensors.pi_session import PiSession
from prismstereo_device.sensors.pixel_formats import planar_pixels
from prismstereo_device.sensors.wishes import require_within, wished_size
from prismstereo_hw.errors import UsageError
from prismstereo_hw.frame import RawFrame

__all__ = ["LENS_UNITS", "PiSensor"]

LENS_UNITS = 100  # a lens position is in hundredths of a dioptre

_OPTIONS = ("width", "height", "rate", "exposure_us", "gain", "lens_position", "colour", "rig")
_USUAL_SIZE, _USUAL_RATE_HZ = (1280, 720), 30.0
_BUFFERS = 4  # one being exposed, one waiting, one finished, one held for a still
_SETTLED_FRAMES = 30  # the white balance is held only after it has found its place
_FOCUS_BY_HAND = 0  # AfModeManual
_FORMAT = "YUV420"


class PiSensor(Sensor):
    """One camera module; `lens_position` is in hundredths of a dioptre, 0 far away.

    `frame.index` follows the camera's clock: a gap tells of frames that nobody had time for.
    """

    stamp_quality = StampQuality.EXPOSURE

    def __init__(
        self, session: PiSession, options: Options, *, frames: int | None = None, rate_hz: float | None = None
    ) -> None:
        self._session, self._left, self._pace = session, frames, Pace(rate_hz)
        self._colour, self.rig = options.flag("colour", default=True), options.rig()
        self._told: Mapping[str, Any] = {}
        self._index, self._stamp_us, self._unsettled = -1, 0, 0
        modes = session.ask(lambda: session.camera.sensor_modes)
        self.modes = listed_modes(modes)
        self._streams = chosen_streams(modes, *self._wished(options))
        self._configure()
        position = options.whole("lens_position", 0)
        if position is None and self.limits.lens_position is not None:  # autofocus would leave the calibration
            position = round(session.camera.camera_controls["LensPosition"][2] * LENS_UNITS)
        if position is not None:
            self.set_lens(position)
        self.set_exposure(Exposure(options.number("exposure_us"), options.number("gain")))
        session.ask(session.camera.start)

    @classmethod
    def parse(cls, argument: str, *, frames: int | None = None, rate_hz: float | None = None) -> PiSensor:
        """Open `[INDEX][?width=1280&height=720&rate=30&exposure_us=8000&gain=2&lens_position=250&rig=pi-camera-v2]`."""
        text, options = Options.behind(argument, _OPTIONS)
        if text and not (text.isascii() and text.isdigit() and len(text) < 4):
            raise UsageError(f"Raspberry Pi camera {text!r}: give its number, 0 for the first one")
        session = PiSession.open(int(text or 0))
        try:
            return cls(session, options, frames=frames, rate_hz=rate_hz)
        except BaseException:
            session.close()
            raise

    def read(self) -> RawFrame | None:
        """Return the newest exposure that was not read yet; `DeviceError` when the camera keeps silent."""
        if self._left == 0:
            return None
        self._pace.wait()
        self._told = told = self._session.next()
        stamp_us = self._mid_exposure_us(told)
        passed = round((stamp_us - self._stamp_us) / (told.get("FrameDuration") or 1e6 / self._streams.rate_hz))
        self._index += 1 if self._index < 0 else max(1, passed)
        self._stamp_us = stamp_us
        frame = self._frame(self._session.planes("lores"), self._streams.lores, told)
        self._settle()
        if self._left is not None:
            self._left -= 1
        return frame

    def still(self) -> Still:
        """Take a still of the newest frame's exposure or, where video has fewer pixels, one right after it."""
        if self._index < 0:
            raise UsageError("a still belongs to a video frame: read one first")
        size: tuple[int, int] = self._streams.main
        if self._streams.still_in_main and self._session.held is not None:
            told, planes = self._told, self._session.planes("main")
        else:
            size = self._streams.full_size
            planes, told = self._session.in_another_mode(self._still_configuration(size))
        crop = told.get("ScalerCrop") or (0, 0, *size)
        return Still(self._frame(planes, size, told), (int(crop[0]), int(crop[1]), int(crop[2]), int(crop[3])))

    def set_exposure(self, exposure: Exposure) -> None:
        """Expose so; `UsageError` where the camera does not go that far."""
        require_within("exposure_us", exposure.exposure_us, self.limits.exposure_us)
        require_within("gain", exposure.gain, self.limits.gain)
        by_hand = exposure.exposure_us is not None and exposure.gain is not None
        if not by_hand:
            self._session.controls.pop("ColourGains", None)  # to send them is to switch automatic white balance off
        self._session.set(exposure_controls(exposure, self._session.camera.camera_controls))
        self._unsettled = _SETTLED_FRAMES if by_hand else 0

    def set_rate(self, rate_hz: float) -> None:
        """Give so many frames a second; `UsageError` where the sensor's mode does not."""
        require_within("rate_hz", rate_hz, self.limits.rate_hz)
        self._session.set({"FrameDurationLimits": _duration_us(rate_hz)})
        self.limits = self._measured_limits(rate_hz)

    def set_lens(self, lens_position: int) -> None:
        """Drive the lens there and hold it; `UsageError` where there is no motor, or it does not go that far."""
        require_within("lens_position", lens_position, self.limits.lens_position)
        self._session.set({"AfMode": _FOCUS_BY_HAND, "LensPosition": lens_position / LENS_UNITS})

    @property
    def temperature_c(self) -> float | None:
        """The sensor's temperature; None where it does not tell."""
        told = self._told.get("SensorTemperature")
        return None if told is None else float(told)

    def close(self) -> None:
        """Let go of the camera."""
        self._session.close()

    def _wished(self, options: Options) -> tuple[tuple[int, int], float]:
        """Return the video's size and rate: as asked for, or the rig's, or the usual ones."""
        video = None if self.rig is None else self.rig.camera.video
        rate_hz = options.number("rate") or (video.rate_hz if video else 0.0) or _USUAL_RATE_HZ
        of_the_rig = _USUAL_SIZE if video is None else (video.width, video.height)
        return wished_size(options) or of_the_rig, rate_hz

    def _configure(self) -> None:
        session, streams = self._session, self._streams
        session.controls["FrameDurationLimits"] = _duration_us(streams.rate_hz)
        configuration = session.ask(
            lambda: session.camera.create_preview_configuration(
                main={"size": streams.main, "format": _FORMAT},
                lores={"size": streams.lores, "format": _FORMAT},
                raw=streams.raw(streams.mode),
                controls=dict(session.controls),
                buffer_count=_BUFFERS,
                display=None,
                encode=None,
            )
        )
        session.ask(lambda: session.camera.configure(configuration))
        for stream, wished in (("main", streams.main), ("lores", streams.lores)):
            width, height = session.camera.stream_configuration(stream)["size"]
            if (width, height) != wished:
                raise UsageError(
                    f"the {session.name} makes {width}x{height} of a {stream} stream of {wished[0]}x{wished[1]}: "
                    "give a size that it keeps"
                )
        self.limits = self._measured_limits(streams.rate_hz)

    def _still_configuration(self, size: tuple[int, int]) -> dict[str, Any]:
        session, streams = self._session, self._streams
        return session.ask(
            lambda: session.camera.create_still_configuration(
                main={"size": size, "format": _FORMAT},
                raw=streams.raw(streams.full),
                controls={key: value for key, value in session.controls.items() if key != "FrameDurationLimits"},
            )
        )

    def _measured_limits(self, rate_hz: float) -> SensorLimits:
        controls = self._session.camera.camera_controls
        exposure, gain, lens = (_limit(controls, name) for name in ("ExposureTime", "AnalogueGain", "LensPosition"))
        duration = _limit(controls, "FrameDurationLimits")
        return SensorLimits(
            exposure_us=exposure and Limit(exposure.least, min(exposure.most, _duration_us(rate_hz)[0])),
            gain=gain,
            rate_hz=duration and Limit(1e6 / duration.most, 1e6 / duration.least),
            lens_position=lens and Limit(lens.least * LENS_UNITS, lens.most * LENS_UNITS),
        )

    def _mid_exposure_us(self, told: Mapping[str, Any]) -> int:
        """Return when the first row was half exposed: the camera stamps the moment when its readout begins."""
        stamp_ns = told.get("SensorTimestamp")
        if stamp_ns is None:
            self.stamp_quality = StampQuality.ARRIVAL
            return time.monotonic_ns() // 1000
        return int((stamp_ns - 500 * told.get("ExposureTime", 0)) // 1000)

    def _frame(self, planes: NDArray[np.uint8], size: tuple[int, int], told: Mapping[str, Any]) -> RawFrame:
        lens = told.get("LensPosition")
        position = None if lens is None else round(lens * LENS_UNITS)
        pixels = planar_pixels(planes, size, colour=self._colour)
        return RawFrame(pixels, self._index, self._mid_exposure_us(told), position)

    def _settle(self) -> None:
        """Hold the white balance where it is, some time after the exposure was set by hand."""
        if self._unsettled:
            self._unsettled -= 1
            known = self._session.camera.camera_controls
            if not self._unsettled and "AwbEnable" in known and "ColourGains" in self._told:
                self._session.set({"AwbEnable": False, "ColourGains": self._told["ColourGains"]})


def _duration_us(rate_hz: float) -> tuple[int, int]:
    """Return the least and the most time from frame to frame: the same, so that the dark does not slow the camera."""
    period_us = round(1e6 / rate_hz)
    return period_us, period_us


def _limit(controls: Mapping[str, tuple[Any, Any, Any]], name: str) -> Limit | None:
    found = controls.get(name)
    return None if found is None else Limit(float(found[0]), float(found[1]))
