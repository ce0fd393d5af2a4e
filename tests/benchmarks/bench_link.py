"""The whole link, from a frame in the service to a frame in the host's loop, on pseudo-terminals paced like real lines.

The time of a frame stands beside that of the ideal line: the same bytes at the line's full rate, with no answer and no pause
between them. The age of a frame is that at its delivery, since its exposure. With PRISMSTEREO_DATA set the maps are real.
"""

from __future__ import annotations

import os
import statistics
import threading
import time
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.bench_codec import matched_map
from benchmarks.row import BenchRow
from device.disparity_corpus import PAIRS, by_sgbm, matched_pair, views_of
from prismstereo.driver import StereoCamera
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.serving.device_identity import DeviceIdentity
from prismstereo_device.serving.rate_control import RateControl
from prismstereo_device.serving.service import Service
from prismstereo_device.source import ProducedFrame

SECONDS = 10.0
SETTLE_S = 3.0  # rate control has chosen by then
BITS_PER_BYTE = 10  # of a serial line
USB_FULL_SPEED = 10_000_000  # baud that make 0.97 MB/s

Map = NDArray[np.uint16]


class Case(NamedTuple):
    """A line, the bound in sixteenths (None: rate control's choice), frames a second of the source, and the map's size."""

    name: str
    baud: int | None
    bound: int | None
    source_hz: float
    small: bool = False


CASES = (
    Case("320x360 over 921600 baud, 1/8 px", 921_600, 2, 25.0, small=True),
    Case("320x360 over 921600 baud, 1/4 px", 921_600, 4, 25.0, small=True),
    Case("640x720 over 3 Mbaud, 1/4 px", 3_000_000, 4, 25.0),
    Case("640x720 over USB full speed, rate control", USB_FULL_SPEED, None, 25.0),
    Case("640x720 over 3 Mbaud, rate control for 10", 3_000_000, None, 10.0),
    Case("320x360 over 115200 baud, rate control for 5", 115_200, None, 5.0, small=True),
    Case("640x720 unpaced, exact", None, 0, 25.0),
)


class Film:
    """Shows maps in turn, a second each, every frame stamped when it is due; nothing is computed."""

    def __init__(self, maps: list[DisparityMap], rate_hz: float) -> None:
        self._maps = maps
        self._rate_hz = rate_hz
        self._begin_s = time.monotonic()
        self._shown = 0
        self.over = False

    def read(self) -> ProducedFrame | None:
        self._shown += 1
        time.sleep(max(0.0, self._begin_s + self._shown / self._rate_hz - time.monotonic()))
        if self.over:
            return None
        return ProducedFrame(
            self._shown,
            time.monotonic_ns() // 1000,
            None,
            self._maps[int(self._shown / self._rate_hz) % len(self._maps)],
        )


class Seen(NamedTuple):
    """Frames a second that arrived, their ages, the bytes of each; each end's share of a core."""

    rate_hz: float
    ages_s: list[float]
    frame_bytes: float
    device_share: float
    host_share: float
    mode: str


def maps_of(small: bool) -> list[DisparityMap]:
    """Give the maps to show: pairs of 640x720, or the same pictures at half the size, matched by SGBM."""
    data = os.environ.get("PRISMSTEREO_DATA")
    if data is None:
        steps = [matched_map()[:360, :320] if small else matched_map()]
    elif small:
        steps = [small_map(Path(data), name) for name in PAIRS]
    else:
        steps = [matched_pair(Path(data), name) for name in PAIRS]
    return [DisparityMap.from_fixed_point(each, DisparityWindow(256)) for each in steps]


def small_map(data: Path, name: str) -> Map:
    """Match one of the pairs at 320x360."""
    left, right, labels = views_of(data, name)
    views = [np.asarray(cv2.resize(each, (320, 360), interpolation=cv2.INTER_AREA), np.uint8) for each in (left, right)]
    return by_sgbm(views[0], views[1], -(-labels // 32) * 16)


def cpu_s(threads: set[threading.Thread]) -> float:
    """Give the processor time that these threads have used."""
    return sum(time.clock_gettime(time.pthread_getcpuclockid(each.ident)) for each in threads if each.ident is not None)


def seen(case: Case, maps: list[DisparityMap]) -> Seen:
    """Let frames run over the line and watch the host's end of it."""
    film = Film(maps, case.source_hz)
    control = RateControl(bound=case.bound)
    before = set(threading.enumerate())
    with (
        PtyPort(baud=case.baud) as port,
        Service(film, port, DeviceIdentity(bytes(8), 1), rate_control=control) as service,
    ):
        device = set(threading.enumerate()) - before
        with StereoCamera.open(port.name, reconnect=False) as camera:
            host = set(threading.enumerate()) - before - device
            frames = iter(camera)
            begin_s = time.monotonic()
            while time.monotonic() < begin_s + SETTLE_S:
                next(frames)
            ages_s: list[float] = []
            begin_s, sent, received = time.monotonic(), service.statistics.sent, camera.statistics.line.received_bytes
            spent = cpu_s(device), cpu_s(host)
            while time.monotonic() < begin_s + SECONDS:
                frame = next(frames)
                ages_s.append(time.monotonic() - frame.timestamp_us / 1e6)
            lasted_s = time.monotonic() - begin_s
            frame_bytes = (camera.statistics.line.received_bytes - received) / (service.statistics.sent - sent)
            now = cpu_s(device), cpu_s(host)
            shares = [(after - then) / lasted_s for after, then in zip(now, spent, strict=True)]
            film.over = True
    mode = f"n={control.mode.bound}{', half' if control.mode.halved else ''}"
    return Seen(len(ages_s) / lasted_s, ages_s, frame_bytes, *shares, mode)


def measure() -> list[BenchRow]:
    rows = []
    for case in CASES:
        found = seen(case, maps_of(case.small))
        frame_s, age_s = 1 / found.rate_hz, statistics.median(found.ages_s)
        note = (
            f"{found.rate_hz:.1f} frames/s, {found.mode}, {found.frame_bytes / 1e3:.1f} kB; age {1e3 * age_s:.0f} ms median, "
            f"{1e3 * float(np.quantile(found.ages_s, 0.99)):.0f} p99, {age_s / frame_s:.1f} frame times; "
            f"of a core with the codec: device {found.device_share:.0%}, host {found.host_share:.0%}"
        )
        ideal_ms = 1e3 * max(1 / case.source_hz, found.frame_bytes * BITS_PER_BYTE / case.baud if case.baud else 0.0)
        rows.append(BenchRow(case.name, 1e3 * frame_s, "ideal line, source", ideal_ms, note))
    return [*rows, *(link_alone(side) for side in (104, 208))]


def link_alone(side_px: int) -> BenchRow:
    """Measure packets and threads alone: noise of two bytes a pixel makes frames as large as others, and is no work to code."""
    steps = np.random.default_rng(1).integers(1, 65535, (side_px, side_px), dtype=np.uint16)
    case = Case(f"link alone, {2e-3 * side_px**2:.0f} kB at 25 frames/s", None, 0, 25.0)
    found = seen(case, [DisparityMap.from_fixed_point(steps, DisparityWindow(4096))])
    shares = found.device_share, found.host_share
    note = f"processor time of the busier end; device {shares[0]:.1%} of a core, host {shares[1]:.1%}"
    return BenchRow(case.name, 1e3 * max(shares) / found.rate_hz, "a twentieth of a core", 0.05e3 / 25, note)
