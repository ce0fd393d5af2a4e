"""A camera that looks at a wall of known distance, small and quick, for the tests of what the desk makes of frames."""

from __future__ import annotations

import copy
import threading
import time
from collections.abc import Callable

import numpy as np

from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.source import ProducedFrame


class Wall:
    """Frames of a wall at `depth_mm`, stamped with the clock when they are made; the picture is the column number."""

    def __init__(
        self, calibration: Calibration, depth_mm: float, *, period_s: float = 0.02, frames: int = 10_000
    ) -> None:
        self.content = flash.pack(calibration)
        self.geometry: Rectification = rectification(flash.unpack(self.content))
        self.stopped = threading.Event()
        self._period_s, self._frames, self._made = period_s, frames, 0
        window, shape = self.geometry.window, (self.geometry.height, self.geometry.width)
        disparity_px = np.full(shape, window.scale_px / depth_mm - window.offset_px, np.float32)
        if window.glass is not None:
            disparity_px -= window.glass.missing_px(disparity_px)
        disparity_px[:8] = np.nan
        columns = np.broadcast_to(np.arange(shape[1]) % 251, shape).astype(np.uint8)
        self.disparity = DisparityMap(disparity_px, window, confidence=columns, reasons=columns // 32)
        self.preview = columns

    def again(self) -> Wall:
        """The same wall from its first frame on."""
        other = copy.copy(self)
        other._made, other.stopped = 0, threading.Event()
        return other

    def read(self) -> ProducedFrame | None:
        if self.stopped.wait(self._period_s) or self._made == self._frames:
            return None
        self._made += 1
        return ProducedFrame(
            self._made,
            time.monotonic_ns() // 1000,
            None,
            self.disparity,
            calibration_hash=flash.digest(self.content),
            preview=self.preview,
        )


def eventually(fact: Callable[[], bool], timeout_s: float = 5.0) -> None:
    until_s = time.monotonic() + timeout_s
    while not fact():
        assert time.monotonic() < until_s, "it did not come about in time"
        time.sleep(0.01)
