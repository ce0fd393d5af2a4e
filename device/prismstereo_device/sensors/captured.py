"""What cameras behind an OpenCV capture have in common: pace, the newest frame, damaged ones passed over."""

from __future__ import annotations

import time
from abc import abstractmethod

from cv2.typing import MatLike

from prismstereo_device.sensors.base import Pace, Sensor, StampQuality
from prismstereo_device.sensors.capture import Capture, CaptureThread
from prismstereo_hw.errors import DeviceError, ImageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig

__all__ = ["CapturedSensor"]


class CapturedSensor(Sensor):
    """A camera whose buffers are drained by a thread.

    `frame.index` counts every buffer that came, so a gap tells of frames that nobody had time for. `damaged` counts the
    pictures that could not be decoded.
    """

    def __init__(
        self,
        capture: Capture,
        name: str,
        *,
        rig: Rig | None = None,
        timeout_s: float,
        frames: int | None = None,
        rate_hz: float | None = None,
    ) -> None:
        self.rig = rig
        self.damaged = 0
        self._name, self._timeout_s, self._left = name, timeout_s, frames
        self._pace = Pace(rate_hz)
        self._thread = CaptureThread(capture, name)

    @abstractmethod
    def _pixels(self, content: MatLike) -> MatLike:
        """Turn a buffer into 8-bit grey or BGR pixels; `ImageError` for a damaged one."""

    @property
    def _lens_position(self) -> int | None:
        return None

    def read(self) -> RawFrame | None:
        """Wait for a frame newer than the last one; `DeviceError` names a camera that went away or keeps silent."""
        if self._left == 0:
            return None
        self._pace.wait()
        begin_s = time.monotonic()
        while True:
            grabbed = self._thread.newest(self._timeout_s)
            try:
                frame = RawFrame(
                    self._pixels(grabbed.content).astype("uint8", copy=False),
                    grabbed.number,
                    grabbed.timestamp_us,
                    self._lens_position,
                )
            except ImageError as error:
                self.damaged += 1
                if time.monotonic() - begin_s > self._timeout_s:
                    raise DeviceError(f"{self._name} gave only damaged pictures: {error}") from error
                continue
            self.stamp_quality = self._quality(by_driver=grabbed.by_driver)
            if self._left is not None:
                self._left -= 1
            return frame

    def _quality(self, *, by_driver: bool) -> StampQuality:
        return StampQuality.DRIVER if by_driver else StampQuality.ARRIVAL

    def _start_again(self, capture: Capture) -> None:
        """Drain another capture, of the same camera in another mode; the numbers go on. The old one is closed by then."""
        self._thread = CaptureThread(capture, self._name, self._thread.next_number)

    def close(self) -> None:
        """Let go of the camera."""
        self._thread.close()
