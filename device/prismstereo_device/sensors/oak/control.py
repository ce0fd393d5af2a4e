"""Exposure, gain and focus of a running camera."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

from prismstereo_device.sensors.base import Exposure, Limit, SensorLimits
from prismstereo_hw.errors import UsageError

__all__ = ["CameraControls", "control_limits", "exposure_control", "focus_control"]

_ISO_PER_GAIN = 100.0  # ISO 100 is the sensor without gain
_LEAST_ISO, _MOST_ISO = 100, 1600  # what depthai calls the usual range
_LEAST_EXPOSURE_US = 1
_LENS = Limit(0, 255)


class CameraControls:
    """Sets a running camera, and sets it again when it came back. `queue` gives its control queue as it is now."""

    def __init__(self, dai: ModuleType, limits: SensorLimits, queue: Callable[[], Any]) -> None:
        self.limits = limits
        self._dai, self._queue = dai, queue
        self._exposure: Any | None = None
        self._lens: Any | None = None
        self._seen = Exposure(10_000.0, 1.0)

    def notice(self, message: Any) -> None:
        """Take note of how a frame was exposed, where it tells."""
        exposure_us = message.getExposureTime().total_seconds() * 1e6
        if exposure_us >= _LEAST_EXPOSURE_US and message.getSensitivity() > 0:
            self._seen = Exposure(exposure_us, message.getSensitivity() / _ISO_PER_GAIN)

    def set_exposure(self, exposure: Exposure) -> None:
        """Expose so; the camera's automatic does both or neither, so a half that is left open stays as it was last."""
        control = exposure_control(self._dai, self._completed(exposure), self.limits)
        self._queue().send(control)
        self._exposure = control

    def set_lens(self, lens_position: int) -> None:
        """Drive the lens there and hold it."""
        control = focus_control(self._dai, lens_position, self.limits)
        self._queue().send(control)
        self._lens = control

    def again(self) -> None:
        """Send what was set once more."""
        for control in (self._exposure, self._lens):
            if control is not None:
                self._queue().send(control)

    def _completed(self, exposure: Exposure) -> Exposure:
        if exposure.exposure_us is None and exposure.gain is None:
            return exposure
        return Exposure(
            self._seen.exposure_us if exposure.exposure_us is None else exposure.exposure_us,
            self._seen.gain if exposure.gain is None else exposure.gain,
        )


def control_limits(rate_hz: float, *, has_motor: bool) -> SensorLimits:
    """Return how far an OAK camera can be set; the exposure ends where the frame does."""
    return SensorLimits(
        exposure_us=Limit(_LEAST_EXPOSURE_US, int(1e6 / rate_hz)),
        gain=Limit(_LEAST_ISO / _ISO_PER_GAIN, _MOST_ISO / _ISO_PER_GAIN),
        rate_hz=Limit(0.1, rate_hz),
        lens_position=_LENS if has_motor else None,
    )


def exposure_control(dai: ModuleType, exposure: Exposure, limits: SensorLimits) -> Any:
    """Return the `dai.CameraControl` for an exposure that says both or neither; `UsageError` beyond the limits."""
    control = dai.CameraControl()
    if exposure.exposure_us is None or exposure.gain is None:
        return control.setAutoExposureEnable()
    for name, value, limit in (
        ("exposure_us", exposure.exposure_us, limits.exposure_us),
        ("gain", exposure.gain, limits.gain),
    ):
        if limit is None or not limit.least <= value <= limit.most:
            reach = "nothing" if limit is None else f"{limit.least:g} to {limit.most:g}"
            raise UsageError(f"{name} {value:g}: at this rate the camera takes {reach}")
    return control.setManualExposure(round(exposure.exposure_us), round(exposure.gain * _ISO_PER_GAIN))


def focus_control(dai: ModuleType, lens_position: int, limits: SensorLimits) -> Any:
    """Return the `dai.CameraControl` that drives the lens; `UsageError` for a lens without a motor and beyond its travel."""
    limit = limits.lens_position
    if limit is None:
        raise UsageError(f"lens position {lens_position}: this OAK's lens has no motor; turn it by hand and calibrate")
    if not limit.least <= lens_position <= limit.most:
        raise UsageError(f"lens position {lens_position}: give {limit.least:g} to {limit.most:g}")
    return dai.CameraControl().setManualFocus(lens_position)
