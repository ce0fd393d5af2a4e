"""The firmware's service, a line that goes wrong, and the desk's camera, for tests of what they stand together."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from prismstereo.driver import StereoCamera
from prismstereo.link_bench.bench_result import Arrival
from prismstereo.link_bench.far_end import NumberedFrames
from prismstereo.link_bench.far_end_state import CountingSetting, MemoryObjects
from prismstereo.link_bench.fault_line import FaultLine
from prismstereo.link_bench.judging import FrameJudge
from prismstereo_device.link import open_link
from prismstereo_device.protocol import Capability
from prismstereo_device.serving.rate_control import RateControl
from prismstereo_device.serving.service import DeviceIdentity, Service

BAUD = 3_000_000
WIDTH, HEIGHT = 320, 180
STRIPES = 12


@dataclass
class Watch:
    """Both ends of a bad line, and every frame that arrived."""

    line: FaultLine
    service: Service
    camera: StereoCamera
    setting: CountingSetting
    objects: MemoryObjects
    arrivals: list[Arrival] = field(default_factory=list)

    def calm(self) -> None:
        """Make the line clean again, wait until frames come, and forget those before."""
        self.line.set_faults("")
        self.frames_from(time.monotonic(), 2)
        self.arrivals.clear()

    @property
    def right(self) -> int:
        """How many stripes arrived and are right."""
        return sum(arrival.judgement.right for arrival in [*self.arrivals])

    @property
    def wrong(self) -> int:
        """How many arrived and are WRONG."""
        return sum(arrival.judgement.wrong for arrival in [*self.arrivals])

    def frames_from(self, since_s: float, count: int, timeout_s: float = 5.0) -> list[Arrival]:
        """Wait until so many frames have come since a moment, and give them."""
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            found = [arrival for arrival in [*self.arrivals] if arrival.at_s >= since_s]
            if len(found) >= count:
                return found
            time.sleep(0.005)
        raise AssertionError(f"{count} frames did not come within {timeout_s:g} s")


@contextmanager
def watched(faults: str = "", *, rate_hz: float = 25.0, baud: int = BAUD, seed: int = 1) -> Iterator[Watch]:
    """Open both ends of a line and read every frame."""
    setting, objects = CountingSetting(), MemoryObjects()
    with FaultLine(faults, baud=baud, seed=seed) as line, open_link(line.device_port, baud=baud) as device:
        service = Service(
            NumberedFrames(WIDTH, HEIGHT, rate_hz),
            device,
            DeviceIdentity(b"faulty-1", 5),
            objects=objects,
            commands=setting,
            rate_control=RateControl(bound=1, line_bytes_per_s=device.bytes_per_s),
            offers=Capability.WRITE,
        )
        with service, StereoCamera.open(line.host_port, baud=baud) as camera:
            watch = Watch(line, service, camera, setting, objects)
            judge = FrameJudge(WIDTH, HEIGHT)
            reading = threading.Thread(target=_read, args=(watch, judge))
            reading.start()
            try:
                watch.frames_from(0.0, 3, 10.0)
                yield watch
            finally:
                camera.close()
                reading.join()


def _read(watch: Watch, judge: FrameJudge) -> None:
    for frame in watch.camera:
        now_s = time.monotonic()
        arrival = Arrival(now_s, now_s - frame.timestamp_us / 1e6, frame.partial, judge.judge(frame))
        watch.arrivals.append(arrival)


def eventually(holds: Callable[[], bool], timeout_s: float = 5.0) -> bool:
    """Wait for something to hold."""
    deadline_s = time.monotonic() + timeout_s
    while not holds() and time.monotonic() < deadline_s:
        time.sleep(0.005)
    return holds()
