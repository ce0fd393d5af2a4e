"""From exposure to the host's callback, over a line as fast as USB full speed, beside the same frame in process."""

from __future__ import annotations

import queue
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.row import BenchRow, interleave
from prismstereo.camera_frame import CameraFrame
from prismstereo.driver import StereoCamera
from prismstereo_calibration.model import Calibration
from prismstereo_device.match import create
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import desk
from prismstereo_hw.twin import Twin

CAMERA = Path(__file__).with_name("latency_camera.py")
USB_FULL_SPEED = 10_000_000  # baud that make 0.97 MB/s
RATES_HZ = (25.0, 15.0)
FRAMES = 250
SETTLING = 50  # the line's speed is learnt first
GOAL_MS = 60.0  # and one frame time more, for 99 of 100


def measure() -> list[BenchRow]:
    rig = Rig.read("oak-1")
    frame, pipeline = Twin(rig, desk(rig)).frame(), Pipeline(Calibration.nominal(rig))
    pair, matcher = pipeline.rectifier.rectify(pipeline.split(frame)), create()
    in_process_ms, _ = interleave(lambda: pipeline.process(frame), lambda: matcher.match(pair))
    return [_row(rate_hz, in_process_ms) for rate_hz in RATES_HZ]


def _row(rate_hz: float, in_process_ms: float) -> BenchRow:
    ages_ms, lost = _ages(rate_hz)
    p99_ms, limit_ms = float(np.percentile(ages_ms, 99)), GOAL_MS + 1000 / rate_hz
    note = f"p99 {p99_ms:.0f} ms, goal {limit_ms:.0f}; 640x720, {FRAMES} frames, {lost} skipped"
    name = f"exposure to callback, {rate_hz:g} Hz"
    return BenchRow(name, float(np.median(ages_ms)), "the pipeline in process", in_process_ms, note)


def _ages(rate_hz: float) -> tuple[list[float], int]:
    """Return how old each frame is, in ms, when the callback has it; both processes have one clock."""
    seen: queue.SimpleQueue[tuple[int, float]] = queue.SimpleQueue()

    def call(frame: CameraFrame) -> None:
        seen.put((frame.index, time.monotonic_ns() / 1e6 - frame.timestamp_us / 1e3))

    with subprocess.Popen(
        [sys.executable, str(CAMERA), str(USB_FULL_SPEED), str(rate_hz)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        port = process.stdout.readline().strip()
        with StereoCamera.open(port, timeout_s=30.0) as camera, camera.on_frame(call, newest=8):
            taken = [seen.get(timeout=10.0) for _ in range(SETTLING + FRAMES)][SETTLING:]
        assert process.stdin is not None
        process.stdin.close()
        process.wait(30)
    skipped = taken[-1][0] - taken[0][0] + 1 - len(taken)
    return [age_ms for _, age_ms in taken], skipped
