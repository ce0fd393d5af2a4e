"""The baseline disparity codec against a 16-bit PNG of the same map, at 640 x 720: milliseconds and bits per pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.row import BenchRow, interleave
from prismstereo_device import codec

HEIGHT, WIDTH = 720, 640
LABELS = 96


def matched_map() -> NDArray[np.uint16]:
    """Match a textured scene of slanted planes by SGBM: (720, 640) uint16 sixteenths with real matching noise."""
    random = np.random.default_rng(2)
    texture = sum(
        cv2.resize(random.normal(size=(HEIGHT // size, WIDTH // size)), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        for size in (1, 2, 5, 16)
    )
    left = np.clip(128 + 28 * texture, 0, 255).astype(np.uint8)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    box = (abs(columns - 380) < 110) & (abs(rows - 330) < 150)
    truth = np.where(box, 62 - 0.02 * rows, 18 + 0.03 * columns + 0.01 * rows).astype(np.float32)
    right = cv2.remap(left, columns + truth, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    noise = random.normal(0, 2.0, (2, HEIGHT, WIDTH))
    views = [np.clip(view + grain, 0, 255).astype(np.uint8) for view, grain in zip((left, right), noise, strict=True)]
    matcher = cv2.StereoSGBM_create(
        minDisparity=0,
        numDisparities=LABELS,
        blockSize=5,
        P1=200,
        P2=800,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
    )
    return np.maximum(matcher.compute(*views), 0).astype(np.uint16)


def decode(stripes: list[bytes]) -> NDArray[np.uint16]:
    """Restore the whole map."""
    rows = codec.rows_per_stripe(WIDTH)
    heights = [min(rows, HEIGHT - top) for top in range(0, HEIGHT, rows)]
    return np.concatenate(
        [codec.decode_stripe(stripe, height, WIDTH) for stripe, height in zip(stripes, heights, strict=True)]
    )


def measure() -> list[BenchRow]:
    """Time encoding and decoding in turn with PNG; both must give the map back exactly."""
    steps = matched_map()
    stripes = codec.encode(steps)
    png = cv2.imencode(".png", steps)[1]
    assert np.array_equal(decode(stripes), steps)
    assert np.array_equal(cv2.imdecode(png, cv2.IMREAD_UNCHANGED), steps)
    size = f"{8 * sum(map(len, stripes)) / steps.size:.2f} bits per pixel, PNG {8 * png.size / steps.size:.2f}"
    encoding = interleave(lambda: codec.encode(steps), lambda: cv2.imencode(".png", steps))
    decoding = interleave(lambda: decode(stripes), lambda: cv2.imdecode(png, cv2.IMREAD_UNCHANGED))
    density = f"{100 * np.count_nonzero(steps) / steps.size:.0f} % matched"
    return [
        BenchRow("disparity to bytes, 640x720", encoding[0], "16-bit PNG (OpenCV)", encoding[1], f"{size}; {density}"),
        BenchRow("bytes to disparity, 640x720", decoding[0], "16-bit PNG (OpenCV)", decoding[1], size),
    ]
