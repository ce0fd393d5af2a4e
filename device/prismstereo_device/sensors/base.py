"""What every sensor is: frames one after the other, what it can be set to, and stills between them."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum

from prismstereo_hw.errors import UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig

__all__ = ["Exposure", "Limit", "Pace", "Sensor", "SensorLimits", "SensorMode", "StampQuality", "Still"]


class StampQuality(Enum):
    """What a frame's stamp means."""

    EXPOSURE = "exposure"  # the sensor's clock at mid-exposure
    DRIVER = "driver"  # the system's clock when the frame was complete, exposure not considered
    ARRIVAL = "arrival"  # this program's clock when the frame was handed over: network and buffers included
    MADE = "made"  # not from a clock at all: a recording or a simulation says it


@dataclass(frozen=True, slots=True)
class SensorMode:
    """One way to read the sensor: frame size in pixels, the camera's name of the pixel format, frames a second (0: unknown)."""

    width: int
    height: int
    pixel_format: str
    rate_hz: float = 0.0


@dataclass(frozen=True, slots=True)
class Limit:
    """The least and most of a control."""

    least: float
    most: float


@dataclass(frozen=True, slots=True)
class SensorLimits:
    """What can be set, and how far; None where it cannot be set at all."""

    exposure_us: Limit | None = None
    gain: Limit | None = None
    rate_hz: Limit | None = None
    lens_position: Limit | None = None


@dataclass(frozen=True, slots=True)
class Exposure:
    """What to expose with: None leaves it to the camera's own automatic, where it has one.

    `gain` is a factor, 1 = none; a camera that tells no unit takes its driver's own number. One sensor holds both views: both
    always share it.
    """

    exposure_us: float | None = None
    gain: float | None = None


@dataclass(frozen=True, slots=True)
class Still:
    """A full-sensor picture taken between video frames.

    `frame` has the still's pixels; its `index` is the video frame that it belongs to. `crop` is the rectangle (x, y, width,
    height) of the full sensor, in its pixels, that the picture shows.
    """

    frame: RawFrame
    crop: tuple[int, int, int, int]


class Sensor(ABC):
    """Gives raw frames; `rig` is known where the sensor knows what stands in front of it.

    `read`, the `set_...` and `still` are called from one thread, `close` after that.
    """

    rig: Rig | None = None
    stamp_quality: StampQuality = StampQuality.MADE
    limits: SensorLimits = SensorLimits()
    modes: tuple[SensorMode, ...] = ()

    @abstractmethod
    def read(self) -> RawFrame | None:
        """Wait for the next frame; None once there are no more. `DeviceError` when the camera went away for good."""

    def set_exposure(self, exposure: Exposure) -> None:
        """Expose so from the next frame on; `UsageError` where this sensor cannot, or not so far."""
        raise UsageError(f"{exposure}: this sensor's exposure and gain cannot be set; leave them as they are")

    def set_rate(self, rate_hz: float) -> None:
        """Give so many frames a second; `UsageError` where this sensor cannot."""
        raise UsageError(f"a rate of {rate_hz:g} Hz: this sensor's rate cannot be set; leave it as it is")

    def set_lens(self, lens_position: int) -> None:
        """Drive the lens there and hold it; `UsageError` where this sensor has no such motor."""
        raise UsageError(f"lens position {lens_position}: this sensor's lens cannot be driven; leave it as it is")

    def still(self) -> Still:
        """Take a still that belongs to the newest frame; `UsageError` where this sensor takes none."""
        raise UsageError("this sensor takes no stills: record video frames instead")

    @property
    def temperature_c(self) -> float | None:
        """The sensor's temperature; None where it does not tell."""
        return None

    def close(self) -> None:  # a source that holds nothing has nothing to let go of
        """Let go of the camera."""
        return


class Pace:
    """Keeps a source from running faster than a rate; no rate, no wait."""

    def __init__(self, rate_hz: float | None) -> None:
        self._period_s = 1 / rate_hz if rate_hz else 0.0
        self._next_s = 0.0

    def set_rate(self, rate_hz: float | None) -> None:
        """Run at most so fast from now on."""
        self._period_s = 1 / rate_hz if rate_hz else 0.0

    def wait(self) -> None:
        """Sleep until the next frame is due; a late source is not hurried to catch up."""
        now = time.monotonic()
        if now < self._next_s:
            time.sleep(self._next_s - now)
        self._next_s = max(now, self._next_s) + self._period_s
