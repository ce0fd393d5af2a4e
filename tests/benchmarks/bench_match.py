"""The default matcher beside the SGBM anchor: one pass, block 5, P1 200, P2 800, uniqueness 10, speckle 100/2, 2 threads."""

from __future__ import annotations

import cv2

from benchmarks.row import BenchRow, interleave
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.match import create
from prismstereo_device.rectify import Rectifier
from prismstereo_device.split import split
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import desk
from prismstereo_hw.twin import Twin


def measure() -> list[BenchRow]:
    rig = Rig.read("oak-1")
    calibration = Calibration.nominal(rig)
    pair = Rectifier(rectification(calibration)).rectify(split(Twin(rig, desk(rig)).frame(), calibration.views))
    anchor = cv2.StereoSGBM.create(0, pair.window.labels, 5, 200, 800, 1, 0, 10, 100, 2, cv2.STEREO_SGBM_MODE_SGBM)
    matcher = create("sgbm")
    ours, peer = interleave(lambda: matcher.match(pair), lambda: anchor.compute(pair.left, pair.right))
    note = f"640x720, {pair.window.labels} labels; ours runs from both views and refines to sub-pixels"
    return [BenchRow("matcher sgbm", ours, "cv2.StereoSGBM, MODE_SGBM, one pass", peer, note)]
