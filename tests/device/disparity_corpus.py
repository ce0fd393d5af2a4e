"""Real disparity maps: of pairs and of a street by SGBM, of a depth camera, and maps that no constant of a codec was fitted on.

Every map is (height, width) uint16 sixteenths of a pixel, 0 where unmatched.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device import match
from prismstereo_device.disparity import FRACTION
from prismstereo_device.rectify import RectifiedPair
from prismstereo_hw import pfm
from sgbm_anchor import sgbm_anchor

__all__ = ["FITTED", "HELD_OUT", "PAIRS", "matched_pair"]

Map = NDArray[np.uint16]
Grey = NDArray[np.uint8]

PAIRS = {
    "teddy": ("gt-middlebury/teddy/im2.png", "gt-middlebury/teddy/im6.png", 56),
    "tsukuba": ("gt-middlebury/tsukuba/im3.png", "gt-middlebury/tsukuba/im4.png", 17),
    "moebius": ("gt-middlebury/moebius_third/view1.png", "gt-middlebury/moebius_third/view5.png", 72),
    "aloe": ("gt-aloe-full/aloeL.jpg", "gt-aloe-full/aloeR.jpg", 212),
    "terrace": ("gt-eth3d-terrace/im0.png", "gt-eth3d-terrace/im1.png", 20),
}


def grey(path: Path) -> Grey:
    """Read a picture as grey."""
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).astype(np.uint8, copy=False)


def views_of(data: Path, name: str) -> tuple[Grey, Grey, int]:
    """Give a real pair, brought to 640 x 720 per view, and the labels that its nearest surface then needs."""
    left, right, largest_px = PAIRS[name]
    views = [grey(data / left), grey(data / right)]
    height, width = views[0].shape
    scale = max(720 / height, 640 / width)
    left_view, right_view = (
        cv2.resize(view, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)[:720, :640] for view in views
    )
    return left_view.astype(np.uint8), right_view.astype(np.uint8), int(largest_px * scale + 2)


def by_sgbm(left: Grey, right: Grey, labels: int) -> Map:
    """Match two views as the documents' anchor does."""
    return np.maximum(sgbm_anchor(labels).compute(left, right), 0).astype(np.uint16)


def matched_pair(data: Path, name: str) -> Map:
    """Match one of the pairs."""
    return by_sgbm(*views_of(data, name))


def street(data: Path, numbers: range) -> list[Map]:
    """Match frames of the street video, 376 x 1145: without the columns that SGBM cannot match."""
    pairs = [
        [grey(data / f"stereo-video-kitti-b/image_{side}/{number:06d}.png") for side in "lr"] for number in numbers
    ]
    return [np.ascontiguousarray(by_sgbm(left, right, 96)[:, 96:]) for left, right in pairs]


def depth_camera(data: Path, numbers: range) -> list[Map]:
    """Give frames of the hand-held depth camera, 480 x 640, as disparity over a baseline of 75 mm."""
    maps = []
    for number in numbers:
        path = data / f"depth-stream-kinect/frame-{number:06d}.depth.png"
        depth_mm = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float)
        maps.append(np.where(depth_mm > 0, np.rint(FRACTION * 585 * 75 / np.maximum(depth_mm, 1)), 0).astype(np.uint16))
    return maps


def small_rig(data: Path) -> list[Map]:
    """Match frames of a small rig with both views side by side, 240 x 320, as they are: its pairs were never rectified."""
    paths = sorted((data / "sbs-stereopi-320").glob("*.png"))[::4]
    return [by_sgbm(frame[:, :320], frame[:, 320:], 64) for frame in map(grey, paths)]


def by_tiles(data: Path) -> list[Map]:
    """Match the pairs with this product's own default matcher."""
    maps = []
    for name in PAIRS:
        left, right, labels = views_of(data, name)
        window = DisparityWindow(-(-labels // 16) * 16)
        maps.append(match.create("tiles").match(RectifiedPair(left, right, window)).fixed_point())
    return maps


def truths(data: Path) -> list[Map]:
    """Give measured truths: in whole pixels (Aloe, Moebius), in quarters (Teddy), and from a laser scanner (terrace)."""
    terrace = pfm.read_disparity(data / "gt-eth3d-terrace/disp0.pfm")
    steps = np.rint(np.nan_to_num(terrace, nan=0.0, posinf=0.0) * FRACTION).astype(np.uint16)
    whole = [grey(data / name) for name in ("gt-aloe-full/aloeGT.png", "gt-middlebury/moebius_third/disp1.png")]
    quarters = grey(data / "gt-middlebury/teddy/disp2.png")
    return [
        steps,
        *(view.astype(np.uint16) * np.uint16(FRACTION) for view in whole),
        quarters.astype(np.uint16) * np.uint16(4),
    ]


# The frozen tables of codec 2 were fitted on these five pairs, also at 320 x 360, and on these frames of the two sequences.
FITTED: dict[str, Callable[[Path], list[Map]]] = {
    "indoor": lambda data: [matched_pair(data, name) for name in PAIRS],
    "street": lambda data: street(data, range(0, 20, 4)),
    "depth camera": lambda data: depth_camera(data, range(150, 200, 10)),
}
HELD_OUT: dict[str, Callable[[Path], list[Map]]] = {
    "street, other frames": lambda data: street(data, range(2, 20, 4)),
    "depth camera, other frames": lambda data: depth_camera(data, range(155, 200, 10)),
    "small rig, not rectified": small_rig,
    "indoor by tiles": by_tiles,
    "truth": truths,
}
