"""The matchers beside OpenCV's: the SGBM anchor (block 5, P1 200, P2 800, uniqueness 10, speckle 100/2) and StereoBM 15x15.

Speed on a scene of the twin and, where PRISMSTEREO_DATA names the real data, on aloe cropped to 640x720 and moved into 128
disparities; quality as the mean over pairs with known truth, each at its own size, of pixels that both views see.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from benchmarks.row import BenchRow, interleave
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_device.match import create
from prismstereo_device.match.base import Matcher, Search
from prismstereo_device.match.tiles.semiglobal import SemiglobalMatcher
from prismstereo_device.match.tiles.tiles import TilesMatcher
from prismstereo_device.rectify import RectifiedPair, Rectifier
from prismstereo_device.split import split
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import desk
from prismstereo_hw.twin import Twin
from sgbm_anchor import sgbm_anchor

LABELS = 128
CROP_ROW, CROP_COLUMN, MOVED_PX = 330, 40, 30  # aloe's crop then has disparities 17 .. 109
MATCHERS: dict[str, Callable[[], Matcher]] = {"tiles": TilesMatcher, "semiglobal": SemiglobalMatcher}
PAIRS = {  # left, right, truth, disparities in a step of truth, labels
    "teddy": ("gt-middlebury/teddy/im2.png", "gt-middlebury/teddy/im6.png", "gt-middlebury/teddy/disp2.png", 4, 64),
    "tsukuba": (
        "gt-middlebury/tsukuba/im3.png",
        "gt-middlebury/tsukuba/im4.png",
        "gt-middlebury/tsukuba/disp3.pgm",
        16,
        16,
    ),
    "moebius": (
        "gt-middlebury/moebius_third/view1.png",
        "gt-middlebury/moebius_third/view5.png",
        "gt-middlebury/moebius_third/disp1.png",
        3,
        80,
    ),
    "aloe": ("gt-aloe-full/aloeL.jpg", "gt-aloe-full/aloeR.jpg", "gt-aloe-full/aloeGT.png", 1, 224),
}


def measure() -> list[BenchRow]:
    rig = Rig.read("oak-1")
    calibration = Calibration.nominal(rig)
    pair = Rectifier(rectification(calibration)).rectify(split(Twin(rig, desk(rig)).frame(), calibration.views))
    rows = [_whole_match(pair)]
    rows += _speed("desk of the twin", pair.left, pair.right)
    data = Path(os.environ.get("PRISMSTEREO_DATA", ""))
    if (data / "gt-aloe-full").is_dir():
        left, right = (_grey(data / PAIRS["aloe"][side]) for side in (0, 1))
        rows += _speed("aloe 640x720", _crop(left, 0), _crop(right, MOVED_PX))
        rows += _quality(data)
    return rows


def _whole_match(pair: RectifiedPair) -> BenchRow:
    matcher, tiles = create("sgbm"), TilesMatcher()
    ours, peer = interleave(lambda: tiles.match(pair), lambda: matcher.match(pair))
    return BenchRow("match() tiles, masks and all", ours, "match() sgbm, both views, refined", peer, "desk of the twin")


def _speed(scene: str, left: np.ndarray, right: np.ndarray) -> list[BenchRow]:
    """Wall and CPU time of each matcher beside the anchor's, and the wall time of tiles beside StereoBM's."""
    anchor, block = sgbm_anchor(LABELS), cv2.StereoBM.create(LABELS, 15)
    rows = []
    for name, make in MATCHERS.items():
        matcher = make()

        def ours(matcher: Matcher = matcher) -> object:
            return matcher.search(left, right, Search(LABELS, threads=2))

        def peer() -> object:
            return anchor.compute(left, right)

        mine, theirs = interleave(ours, peer)
        rows.append(BenchRow(f"{name}, {scene}", mine, "StereoSGBM", theirs, "wall, 128 labels, 2 threads"))
        rows.append(_cpu(f"{name}, {scene}, CPU", ours, peer))
        if name == "tiles":
            beside = interleave(ours, lambda: block.compute(left, right))
            rows.append(BenchRow(f"{name}, {scene}", beside[0], "StereoBM 15x15", beside[1], "wall, 2 threads"))
    return rows


def _cpu(name: str, ours: Callable[[], object], peer: Callable[[], object], rounds: int = 9) -> BenchRow:
    """CPU time of all threads, interleaved, medians: it holds on a busy machine too."""
    spent: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for kept, job in zip(spent, (ours, peer), strict=True):
            begin = time.process_time()
            job()
            kept.append((time.process_time() - begin) * 1e3)
    mine, theirs = (statistics.median(kept) for kept in spent)
    return BenchRow(name, mine, "StereoSGBM", theirs, "CPU of all threads")


def _grey(file: Path) -> np.ndarray:
    return np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))


def _crop(picture: np.ndarray, moved: int) -> np.ndarray:
    return np.ascontiguousarray(picture[CROP_ROW : CROP_ROW + 720, CROP_COLUMN - moved : CROP_COLUMN - moved + 640])


def _quality(data: Path) -> list[BenchRow]:
    """Percent of pixels more than 2 px off, unmatched counted as bad, and of the matched alone; means over the pairs."""
    bad: dict[str, list[tuple[float, float]]] = {}
    for left_name, right_name, truth, scale, labels in PAIRS.values():
        left, right, true_px = _grey(data / left_name), _grey(data / right_name), _grey(data / truth) / scale
        steps = sgbm_anchor(labels).compute(left, right)
        found = {name: make().search(left, right, Search(labels)).disparity_px for name, make in MATCHERS.items()}
        found["StereoSGBM"] = np.where(steps < 0, np.nan, steps / np.float32(16))
        judged = (true_px > 0) & _seen(true_px)
        for name, disparity in found.items():
            off = np.abs(disparity - true_px)[judged]
            bad.setdefault(name, []).append((float(np.mean(~(off <= 2))), float(np.mean(off[np.isfinite(off)] > 2))))
    means = {name: 100 * np.mean(values, axis=0) for name, values in bad.items()}
    anchor = means.pop("StereoSGBM")
    note = f"percent, not ms; mean of {', '.join(PAIRS)}"
    return [
        BenchRow(f"{name}, {what}", float(mean[kind]), "StereoSGBM", float(anchor[kind]), note)
        for name, mean in means.items()
        for kind, what in enumerate(("bad-2, unmatched bad", "bad-2 of the matched"))
    ]


def _seen(true_px: np.ndarray) -> np.ndarray:
    """Where the right view sees the pixel: nothing nearer lands on its partner, a column more or less."""
    height, width = true_px.shape
    columns = np.arange(width) - true_px
    partner = np.rint(columns).astype(int)
    inside = (true_px > 0) & (partner >= 0)
    rows = np.broadcast_to(np.arange(height)[:, None], true_px.shape)
    nearest = np.zeros((height, width))
    np.maximum.at(nearest, (rows[inside], partner[inside]), true_px[inside])
    nearest = np.maximum(nearest, np.minimum(np.roll(nearest, 1, axis=1), np.roll(nearest, -1, axis=1)))
    seen = np.zeros(true_px.shape, bool)
    seen[inside] = true_px[inside] >= nearest[rows[inside], partner[inside]] - 1
    return seen
