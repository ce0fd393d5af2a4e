"""Filters and reasons of a 640x720 map, beside the SGBM that matches such a pair, and beside OpenCV's speckle filter."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from benchmarks.row import BenchRow, interleave
from prismstereo_calibration.model import Calibration
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters import PRESETS, FilterChain, chain, explained
from prismstereo_device.filters.clean import Clean
from prismstereo_device.filters.speckle import Speckle
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import desk
from prismstereo_hw.twin import Twin
from sgbm_anchor import sgbm_anchor

LABELS = 128


def measure() -> list[BenchRow]:
    rig = Rig.read("oak-1")
    pipeline = Pipeline(Calibration.nominal(rig))
    pair = pipeline.rectifier.rectify(pipeline.split(Twin(rig, desk(rig), noise=1.5).frame()))
    anchor = sgbm_anchor(LABELS)
    sixteenths = anchor.compute(pair.left, pair.right)
    found = np.where(sixteenths < 0, np.nan, sixteenths / np.float32(16)).astype(np.float32)
    matched = DisparityMap(found, pair.window)

    def sgbm() -> None:
        anchor.compute(pair.left, pair.right)

    def rows(name: str, work: Callable[[], object]) -> BenchRow:
        ours, peer = interleave(work, sgbm, rounds=9)
        return BenchRow(name, ours, "OpenCV SGBM", peer, f"{100 * ours / peer:.1f} % of matching")

    streams = {name: chain(name).stream() for name in PRESETS}
    cleaning, speckle = FilterChain((Clean(),)), FilterChain((Speckle(largest_pixels=100, step_px=1.0),))
    ours, peer = interleave(
        lambda: speckle.apply(matched), lambda: cv2.filterSpeckles(sixteenths.copy(), -16, 100, 16), rounds=21
    )
    return [
        *(
            rows(f"filters {name}, 640x720", lambda s=each: s.apply(matched, pair.left))
            for name, each in streams.items()
        ),
        rows("filter clean, 640x720", lambda: cleaning.apply(matched, pair.left)),
        rows("reasons, 640x720", lambda: explained(matched, pair.left, pair.right, pair.left_seen)),
        BenchRow("filter speckle with reasons, 640x720", ours, "cv2.filterSpeckles", peer),
    ]
