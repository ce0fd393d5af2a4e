"""What every sensor is."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod

from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig

__all__ = ["Pace", "Sensor"]


class Sensor(ABC):
    """Gives raw frames; `rig` is known where the sensor knows what stands in front of it."""

    rig: Rig | None = None

    @abstractmethod
    def read(self) -> RawFrame | None:
        """Wait for the next frame; None once there are no more. `DeviceError` when the camera went away."""

    def close(self) -> None:  # a source that holds nothing has nothing to let go of
        """Let go of the camera."""
        return


class Pace:
    """Keeps a source from running faster than a rate; no rate, no wait."""

    def __init__(self, rate_hz: float | None) -> None:
        self._period_s = 1 / rate_hz if rate_hz else 0.0
        self._next_s = 0.0

    def wait(self) -> None:
        """Sleep until the next frame is due; a late source is not hurried to catch up."""
        now = time.monotonic()
        if now < self._next_s:
            time.sleep(self._next_s - now)
        self._next_s = max(now, self._next_s) + self._period_s
