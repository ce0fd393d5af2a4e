"""From depthai's messages to frames: pixels, time, focus, and which part of the sensor they show.

Time is `getTimestamp(MIDDLE)`: the middle of the exposure on `time.monotonic()`'s clock, which is also the clock that the
service answers the host's pings with. depthai keeps the camera's own clock fitted to it. That clock itself
(`getTimestampDevice`) would be a third one, which no host could ask about.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.outputs import Output
from prismstereo_hw.errors import ImageError
from prismstereo_hw.frame import RawFrame

__all__ = ["OutputPlace", "picture", "raw_frame", "timestamp_us"]

_MICROSECOND = timedelta(microseconds=1)


@dataclass(frozen=True, slots=True)
class OutputPlace:
    """Which rectangle of the full sensor an output of the camera shows, and in how many pixels.

    `crop` is x, y, width, height in sensor pixels, counted from the sensor's corner, not from a pixel's centre.
    """

    crop: tuple[float, float, float, float]
    width: int
    height: int

    @classmethod
    def of(cls, dai: ModuleType, message: Any) -> OutputPlace:
        """Read it from a `dai.ImgFrame`; one that does not say is its own sensor."""
        width, height = int(message.getWidth()), int(message.getHeight())
        way = message.getTransformation()
        if not way.isValid():
            return cls((0.0, 0.0, float(width), float(height)), width, height)
        first = way.invTransformPoint(dai.Point2f(0.0, 0.0))
        last = way.invTransformPoint(dai.Point2f(float(width), float(height)))
        return cls((first.x, first.y, last.x - first.x, last.y - first.y), width, height)

    @property
    def whole_crop(self) -> tuple[int, int, int, int]:
        """The rectangle in whole sensor pixels."""
        x, y, width, height = (round(edge) for edge in self.crop)
        return x, y, width, height

    def as_output(self, name: str, calibrated: OutputPlace) -> Output:
        """Return the way from pixels of the calibrated output to pixels of this one: both show parts of one sensor."""
        across, down = self.width / self.crop[2], self.height / self.crop[3]
        scale = across * calibrated.crop[2] / calibrated.width
        shifts = [
            (calibrated.crop[axis] - self.crop[axis]) * each + scale / 2 - 0.5
            for axis, each in enumerate((across, down))
        ]
        return Output(name, self.width, self.height, scale, shifts[0], shifts[1])


def timestamp_us(dai: ModuleType, message: Any) -> int:
    """Return the middle of the exposure in microseconds of `time.monotonic()`'s clock."""
    since: timedelta = message.getTimestamp(dai.CameraExposureOffset.MIDDLE)
    return round(since / _MICROSECOND)


def picture(message: Any) -> NDArray[np.uint8]:
    """Return a message's pixels, (height, width) grey or (height, width, 3) BGR; `ImageError` for one that is damaged."""
    try:
        pixels = np.asarray(message.getCvFrame())
    except RuntimeError as error:
        raise ImageError(f"frame {message.getSequenceNum()} of the OAK camera cannot be read: {error}") from error
    if pixels.dtype != np.uint8:
        raise ImageError(
            f"frame {message.getSequenceNum()} of the OAK camera is {pixels.dtype}: 8-bit pixels were asked for"
        )
    return np.ascontiguousarray(pixels, np.uint8)


def raw_frame(dai: ModuleType, message: Any, index: int, *, tells_lens: bool) -> RawFrame:
    """Make a raw frame of a `dai.ImgFrame`; a lens without a motor tells a position that means nothing."""
    position = int(message.getLensPosition()) if tells_lens else None
    return RawFrame(picture(message), index, timestamp_us(dai, message), position)
