"""Codec 2 on maps of real pairs: bits per pixel of the whole map, tables included."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_device.codec.compact import encode_stripes
from sgbm_anchor import sgbm_anchor

Map = NDArray[np.uint16]


def matched_pair(left: Path, right: Path, largest_px: int) -> Map:
    """Match a real pair, brought to 640 x 720 per view, as the documents' anchor does."""
    views = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in (left, right)]
    height, width = views[0].shape
    scale = max(720 / height, 640 / width)
    views = [cv2.resize(view, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)[:720, :640] for view in views]
    matcher = sgbm_anchor(int(largest_px * scale + 2))
    return np.maximum(matcher.compute(*views), 0).astype(np.uint16)


PAIRS = {
    "teddy": ("gt-middlebury/teddy/im2.png", "gt-middlebury/teddy/im6.png", 56),
    "tsukuba": ("gt-middlebury/tsukuba/im3.png", "gt-middlebury/tsukuba/im4.png", 17),
    "moebius": ("gt-middlebury/moebius_third/view1.png", "gt-middlebury/moebius_third/view5.png", 72),
    "aloe": ("gt-aloe-full/aloeL.jpg", "gt-aloe-full/aloeR.jpg", 212),
    "terrace": ("gt-eth3d-terrace/im0.png", "gt-eth3d-terrace/im1.png", 20),
}


@pytest.mark.soak
@pytest.mark.parametrize(("bound", "most_bpp"), [(0, 1.55), (2, 0.70), (4, 0.52)])
def test_real_maps_take_few_bits(data: Path, bound: int, most_bpp: float) -> None:
    maps = {name: matched_pair(data / left, data / right, most) for name, (left, right, most) in PAIRS.items()}
    bits = {name: 8 * encode_stripes(steps, bound).size / steps.size for name, steps in maps.items()}
    table = ", ".join(f"{name} {value:.2f}" for name, value in bits.items())
    print(f"codec 2 within {bound}/16 px, bits per pixel: {table}; mean {np.mean(list(bits.values())):.3f}")
    assert np.mean(list(bits.values())) <= most_bpp
