"""Split and rectify of a 1280x720 frame, beside two bare remaps with floating-point maps."""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks.row import BenchRow, interleave
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.rectify import Rectifier
from prismstereo_device.split import split
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin


def measure() -> list[BenchRow]:
    rig = Rig.read("oak-1")
    calibration = Calibration.nominal(rig)
    found = rectification(calibration)
    rectifier = Rectifier(found)
    frame = Twin(rig, facing_plane(rig, 700)).frame()
    sources = [np.nan_to_num(found.sources(side), nan=-16) for side in (found.left, found.right)]
    maps = [[np.ascontiguousarray(where[..., axis]) for axis in (0, 1)] for where in sources]
    pair = split(frame, calibration.views)

    def bare() -> None:
        for picture, (columns, rows) in zip((pair.left, pair.right), maps, strict=True):
            cv2.remap(picture, columns, rows, cv2.INTER_LINEAR)

    ours, peer = interleave(lambda: rectifier.rectify(split(frame, calibration.views)), bare, rounds=21)
    return [BenchRow("split + rectify, 1280x720 -> 2 x 640x720", ours, "two cv2.remap, float maps", peer)]
