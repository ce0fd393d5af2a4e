"""A camera in a process of its own, for the latency benchmark: frames of the twin, stamped by the clock at exposure.

python tests/benchmarks/latency_camera.py BAUD RATE_HZ      prints its port; ends with its standard input
"""

from __future__ import annotations

import sys
import time

import cv2

from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.pipeline import Pipeline
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import DeviceIdentity, Service
from prismstereo_device.source import ProducedFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import desk
from prismstereo_hw.twin import Twin

RENDERED = 4


class Exposed:
    """Exposes at a steady rate; a frame whose time has come while the one before is matched is skipped, as a camera does."""

    def __init__(self, rate_hz: float) -> None:
        rig = Rig.read("oak-1")
        twin = Twin(rig, desk(rig))
        self._frames = [twin.frame(index) for index in range(RENDERED)]  # rendering is no part of a camera
        self.calibration = flash.pack(Calibration.nominal(rig))
        self._pipeline = Pipeline(Calibration.nominal(rig))
        self._pipeline.process(self._frames[0])
        self._period_s, self._begin_s, self._index = 1 / rate_hz, time.monotonic(), 0

    def read(self) -> ProducedFrame | None:
        now_s = time.monotonic()
        self._index = max(self._index + 1, int((now_s - self._begin_s) / self._period_s) + 1)
        time.sleep(max(0.0, self._begin_s + self._index * self._period_s - now_s))
        exposed_us = time.monotonic_ns() // 1000
        disparity = self._pipeline.process(self._frames[self._index % RENDERED])
        return ProducedFrame(self._index, exposed_us, None, disparity, calibration_hash=flash.digest(self.calibration))


def main(baud: int, rate_hz: float) -> None:
    cv2.setNumThreads(2)
    source = Exposed(rate_hz)
    objects = FixedObjects({ObjectNumber.CALIBRATION: source.calibration})
    with PtyPort(baud=baud) as link, Service(source, link, DeviceIdentity(bytes(8), 1), objects=objects):
        print(link.name, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
