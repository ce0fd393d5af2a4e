"""Motion of a 640x720 video half: dense SIFT and change mask beside OpenCV's SIFT on that grid, the guide beside dense flow."""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks.row import BenchRow, interleave
from host.motion_compositions import compose, variant
from prismstereo.fusion.motion import Background, PreparedStill, change_mask, guide_for
from prismstereo.fusion.motion.dense_sift import STEP_PX, DenseSift
from prismstereo.fusion.motion.picture import grey

MARGIN_PX = 8  # of a descriptor of 16 x 16 pixels


def measure() -> list[BenchRow]:
    made = compose(variant(video=(720, 640), scale=3.7125))
    flat = grey(made.frame)
    small, before = flat.astype(np.uint8), grey(made.background_video).astype(np.uint8)
    height, width = small.shape
    points = [
        cv2.KeyPoint(
            float(x), float(y), 16 / 3
        )  # OpenCV's bins are 3 / 2 of the size wide on either side: 4 pixels here
        for y in range(MARGIN_PX, height - MARGIN_PX, STEP_PX)
        for x in range(MARGIN_PX, width - MARGIN_PX, STEP_PX)
    ]
    sift, flow = cv2.SIFT.create(), cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    background = Background.of(made.background_video, made.background_still, made.grid)
    still = PreparedStill.of(made.still, background)

    def grid() -> None:
        sift.compute(small, points)

    dense = interleave(lambda: DenseSift.of(flat), grid, rounds=5)
    change = interleave(lambda: change_mask(made.frame, background), grid, rounds=5)
    ready = interleave(lambda: PreparedStill.of(made.still, background), grid, rounds=3)
    guide = interleave(
        lambda: guide_for(made.frame, still, background), lambda: flow.calc(before, small, None), rounds=5
    )
    return [
        BenchRow("dense SIFT, 640x720, step 4", *_pair(dense, "cv2.SIFT on the grid"), "one thread of ours"),
        BenchRow("change mask, 640x720", *_pair(change, "cv2.SIFT on the grid"), "light, shake, dense SIFT, colour"),
        BenchRow("still made ready, 2376x2673", *_pair(ready, "cv2.SIFT on the grid"), "once a still"),
        BenchRow("guide of a frame, 2376x2673", *_pair(guide, "DIS flow 640x720"), "one object, blurred by motion"),
    ]


def _pair(times: tuple[float, float], peer: str) -> tuple[float, str, float]:
    return times[0], peer, times[1]
