"""The optical twin's video frame and full-sensor still, beside a bare remap of a picture of the same size."""

from __future__ import annotations

import subprocess
import sys

import cv2
import numpy as np

from benchmarks.row import BenchRow, interleave
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import named
from prismstereo_hw.twin import Twin

_PEAK = """
import resource
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import named
from prismstereo_hw.twin import Twin
rig = Rig.read("dslr-35mm")
Twin(rig, named(rig, "desk"), mode=rig.camera.still).frame()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def still_peak_kib() -> int:
    """Return the largest resident size of a fresh process that renders one full-sensor still."""
    done = subprocess.run([sys.executable, "-c", _PEAK], capture_output=True, text=True, timeout=600, check=True)
    return int(done.stdout)


def _row(rig: Rig, mode: Mode, rounds: int, note: str = "") -> BenchRow:
    twin = Twin(rig, named(rig, "desk"), mode=mode)
    picture = twin.frame().pixels
    columns, rows = np.meshgrid(np.arange(mode.width, dtype=np.float32), np.arange(mode.height, dtype=np.float32))
    columns += np.float32(0.4)
    ours, peer = interleave(twin.frame, lambda: cv2.remap(picture, columns, rows, cv2.INTER_LINEAR), rounds=rounds)
    note = f"{ours / peer:.0f} times a remap{note}"
    return BenchRow(f"twin, {mode.width}x{mode.height} of a desk", ours, "cv2.remap, float maps", peer, note)


def measure() -> list[BenchRow]:
    rig = Rig.read("dslr-35mm")
    peak = still_peak_kib() / 1024
    return [
        _row(rig, rig.camera.video, rounds=7),
        _row(rig, rig.camera.still, rounds=2, note=f"; peak of a fresh process {peak:.0f} MiB"),
    ]
