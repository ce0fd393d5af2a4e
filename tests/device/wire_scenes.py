"""Maps, and the packets that carry them, for the tests of the protocol."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.framing import Packet
from prismstereo_device.protocol import FrameAssembler, ReceivedFrame, fragment
from prismstereo_device.wire import Channel

WINDOW = DisparityWindow(128, -1.0, 12345.0)


def scene(height: int = 100, width: int = 90, seed: int = 0) -> DisparityMap:
    """A map of wild steps and holes, so unlike what the frozen tables expect that tables of its own save a fifth and more."""
    random = np.random.default_rng(seed)
    steps = random.integers(0, 40, (height, width)).cumsum(1) * (random.random((height, width)) < 0.9)
    return DisparityMap.from_fixed_point(steps.astype(np.uint16), WINDOW)


def matched() -> DisparityMap:
    """A map with the smooth errors and holes of a matcher, such as the frozen tables were made for."""
    random = np.random.default_rng(0)
    error = cv2.GaussianBlur(random.standard_t(2.5, (100, 160)), None, 1.5) * np.repeat([5, 20, 60], 34)[:100, None]
    holes = (random.random((13, 21)) < 0.1).repeat(8, 0).repeat(8, 1)[:100, :160]
    steps = np.where(holes, 0, np.rint(300 + 0.4 * np.arange(160) + error).clip(0)).astype(np.uint16)
    return DisparityMap.from_fixed_point(steps, WINDOW)


def packets_of(disparity: DisparityMap, frame: int = 5, mtu: int = 4096, bound: int | None = None) -> list[Packet]:
    """The packets of a frame at 777 us with lens position 120, filter set 3 and calibration `12345678`."""
    parts = fragment(
        disparity,
        frame=frame,
        timestamp_us=777,
        calibration_hash=b"12345678",
        mtu=mtu,
        lens_position=120,
        filter_set=3,
        bound=bound,
    )
    return [Packet(Channel.DISP, payload, flags, 0, frame & 0xFFFF, index) for flags, index, payload in parts]


def received(assembler: FrameAssembler, packets: list[Packet]) -> list[ReceivedFrame]:
    """What an assembler makes of packets."""
    return [frame for packet in packets for frame in assembler.feed(packet)]


def quickest_s(work: Callable[[], object], enough_s: float) -> float:
    """Processor time of `work` in seconds: the least of up to four, since one may meet the garbage collector."""
    best = float("inf")
    for _ in range(4):
        begin = time.thread_time()
        work()
        best = min(best, time.thread_time() - begin)
        if best < enough_s:
            break
    return best
