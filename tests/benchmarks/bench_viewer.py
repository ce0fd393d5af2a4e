"""The viewer at 640x360 and 15 frames a second: processor time of its server, bytes to a browser, and what a slow one costs.

The camera sends disparity with real matching noise (codec 2, exact) and five previews a second from this process; the server
runs in one of its own, so that its processor time is nobody else's.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import msgspec
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.bench_codec import matched_map
from benchmarks.row import BenchRow, interleave
from host.small_device import SmallDevice
from host.viewer_rig import IDENTITY, Settable
from prismstereo.viewer.message import packed_steps
from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.link.tcp import TcpServer
from prismstereo_device.objects import Held, ObjectNumber
from prismstereo_device.protocol import PictureKind, calibration_hash, fragment, picture_fragments
from prismstereo_device.wire import Channel
from prismstereo_hw.rig import Mode, Rig

WIDTH, HEIGHT, RATE_HZ = 640, 360, 15.0
PREVIEW_EVERY = 3
SECONDS = 10.0
MAPS = 6


def measure() -> Iterator[BenchRow]:
    steps = matched_map()[:HEIGHT, :WIDTH]
    ours, peer = interleave(lambda: packed_steps(steps), lambda: zlib.compress(steps.tobytes(), 1))
    sizes = len(packed_steps(steps)) / 1e3, len(zlib.compress(steps.tobytes(), 1)) / 1e3
    yield BenchRow("map packed for a page", ours, "zlib-1", peer, f"{sizes[0]:.0f} kB against {sizes[1]:.0f} kB")
    with _server() as (url, process):
        alone = _during(process, url, quick=0, deaf=0)
        one = _during(process, url, quick=1, deaf=0)
        beside = _during(process, url, quick=1, deaf=1)
        four = _during(process, url, quick=4, deaf=0)
    for name, found in (("one page", one), ("a page beside a deaf one", beside), ("four pages", four)):
        note = f"{found.share:.0%} of a core, {found.megabytes_per_s:.1f} MB/s and {found.rate_hz:.1f} Hz a page"
        yield BenchRow(f"server's time a frame, {name}", found.frame_ms, "no page", alone.frame_ms, note)


class _Found(msgspec.Struct):
    share: float
    megabytes_per_s: float
    rate_hz: float

    @property
    def frame_ms(self) -> float:
        return 1000 * self.share / RATE_HZ


def _during(process: subprocess.Popen[str], url: str, *, quick: int, deaf: int) -> _Found:
    """Watch with so many pages for a while; `deaf` ones never acknowledge anything."""
    counts = [[0, 0] for _ in range(quick)]
    stop = threading.Event()
    with ExitStack() as stack:
        for _ in range(deaf):
            stack.enter_context(connect(f"ws{url[4:]}live", origin=url.rstrip("/")))
        pages = [threading.Thread(target=_page, args=(url, count, stop)) for count in counts]
        for page in pages:
            page.start()
        time.sleep(2.0)
        begin_s, begin_cpu_s, before = time.monotonic(), _cpu_s(process.pid), [list(count) for count in counts]
        time.sleep(SECONDS)
        wall_s, cpu_s = time.monotonic() - begin_s, _cpu_s(process.pid) - begin_cpu_s
        got = np.array(counts).reshape(-1, 2) - np.array(before).reshape(-1, 2)
        stop.set()
        for page in pages:
            page.join()
    frames, size = (got.mean(axis=0) / wall_s) if quick else (0.0, 0.0)
    return _Found(cpu_s / wall_s, float(size) / 1e6, float(frames))


def _page(url: str, count: list[int], stop: threading.Event) -> None:
    with connect(f"ws{url[4:]}live", origin=url.rstrip("/"), max_size=None) as line:
        line.send('{"show": ["left"]}')
        while not stop.is_set():
            try:
                message = line.recv(1.0)
            except (TimeoutError, ConnectionClosed):
                continue
            if isinstance(message, bytes):
                line.send(f'{{"ack": [{message[0]}]}}')
                count[0] += message[0] == 1
                count[1] += len(message)


def _cpu_s(number: int) -> float:
    fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _server() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    oak = Rig.read("oak-1")
    camera = msgspec.structs.replace(oak.camera, video=Mode(width=2 * WIDTH, height=HEIGHT, rate_hz=RATE_HZ))
    calibration = Calibration.nominal(msgspec.structs.replace(oak, camera=camera))
    content = flash.pack(calibration)
    link, stop = TcpServer(), threading.Event()
    answering = Settable({ObjectNumber.CALIBRATION: Held(1, content), ObjectNumber.IDENTITY: Held(1, IDENTITY)})
    with TemporaryDirectory() as folder, SmallDevice(link, answering=answering) as device:
        sending = threading.Thread(target=_send, args=(device, calibration, calibration_hash(content), stop))
        sending.start()
        arguments = ["view", link.name, "--no-browser", "--port", "0", "--records", folder]
        with subprocess.Popen(
            [sys.executable, "-m", "prismstereo", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as process:
            assert process.stdout is not None
            try:
                yield process.stdout.readline().strip(), process
            finally:
                process.terminate()
                process.wait(20)
                stop.set()
                sending.join()
        link.close()


def _send(device: SmallDevice, calibration: Calibration, named: bytes, stop: threading.Event) -> None:
    """Send packets that were made before, so that this process takes little of the machine."""
    window, steps = rectification(calibration).window, matched_map()
    maps = [DisparityMap.from_fixed_point(steps[40 * i : 40 * i + HEIGHT, :WIDTH], window) for i in range(MAPS)]
    texture = np.random.default_rng(3).normal(128, 40, (HEIGHT // 2, WIDTH // 2)).astype(np.float32)
    preview = np.clip(cv2.resize(texture, (WIDTH, HEIGHT)), 0, 255).astype(np.uint8)
    number, due_s = 0, time.monotonic()
    while not stop.wait(max(0.0, due_s - time.monotonic())):
        due_s += 1 / RATE_HZ
        stamp_us = time.monotonic_ns() // 1000
        made = fragment(
            maps[number % MAPS], frame=number, timestamp_us=stamp_us, calibration_hash=named, mtu=4096, bound=0
        )
        for flags, index, payload in made:
            device.send(Channel.DISP, payload, flags, number & 0xFFFF, index)
        if number % PREVIEW_EVERY == 0:
            shown = picture_fragments(preview, kind=PictureKind.PREVIEW, frame=number, timestamp_us=stamp_us, mtu=4096)
            for flags, index, payload in shown:
                device.send(Channel.IMG, payload, flags, number & 0xFFFF, index)
        number += 1
