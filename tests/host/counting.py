"""A source of numbered frames and the service that sends them, for the tests of the desk."""

from __future__ import annotations

import threading
import time

import numpy as np

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.link import Link
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.protocol import calibration_hash
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import DeviceIdentity, ProducedFrame, Service
from prismstereo_hw.errors import DeviceError

IDENTITY = DeviceIdentity(b"serial-1", 77)
CALIBRATION = bytes(range(256)) * 60


def disparity(seed: int, height: int = 96, width: int = 80) -> DisparityMap:
    steps = np.random.default_rng(seed).integers(0, 4000, (height, width), dtype=np.uint16)
    return DisparityMap.from_fixed_point(steps, DisparityWindow(256, -1.0, 5000.0))


class Counting:
    """A source of numbered frames; after the last one it ends, or breaks, or computes on until it is let go."""

    def __init__(self, frames: int, *, period_s: float = 0.0, then: str = "end", first: int = 0) -> None:
        self.let_go = threading.Event()
        self._frames = frames
        self._first = first
        self._made = 0
        self._period_s = period_s
        self._then = then

    def read(self) -> ProducedFrame | None:
        time.sleep(self._period_s)
        if self._made < self._frames:
            self._made += 1
            index = self._first + self._made - 1
            return ProducedFrame(
                index, self._made * 1000, 120, disparity(index % 16), calibration_hash=calibration_hash(CALIBRATION)
            )
        if self._then == "break":
            raise DeviceError("the sensor was pulled out")
        if self._then == "compute":
            self.let_go.wait(20)
        return None


def serve(
    source: Counting,
    link: Link,
    *,
    calibration: bytes = CALIBRATION,
    lossless: bool = False,
    identity: DeviceIdentity = IDENTITY,
) -> Service:
    objects = FixedObjects({ObjectNumber.CALIBRATION: calibration} if calibration else {})
    return Service(source, link, identity, objects=objects, lossless=lossless)
