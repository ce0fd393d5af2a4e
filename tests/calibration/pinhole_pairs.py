"""Pinhole pairs whose files others are asked to read: an oak-1 with a lens of its own, and points before it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish, Rig

Array = NDArray[np.float64]
FRAME = (1280, 720)


@cache
def prism() -> Calibration:
    """An oak-1 as pinholes, with a principal point of its own, tangential terms, and a range that ends at 3 m."""
    flat = Calibration.nominal(Rig.read("oak-1")).pinholes()
    lens = replace(flat.left.lens, cx_px=645.25, cy_px=352.5, distortion=(0.03, -0.02, 5e-4, -3e-4, 0.0))
    wish = RangeWish(near_mm=300.0, far_mm=3000.0, labels=192)
    return replace(flat, left=Camera.at_origin(lens), right=replace(flat.right, lens=lens), range=wish)


def in_front(one: Calibration) -> Array:
    """Points (N, 3) that both lenses look at, in the left camera's frame."""
    random = np.random.default_rng(0)
    x, y, w, h = one.left_view.rectangle(*FRAME)
    pixels = np.array([x, y]) + random.uniform(size=(50, 2)) * np.array([w - 1, h - 1])
    return one.left.directions(pixels) * random.uniform(300, 3000, (50, 1))


def numbers(lens: Lens) -> list[float]:
    return [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion]
