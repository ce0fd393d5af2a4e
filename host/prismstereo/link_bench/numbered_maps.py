"""Disparity maps that both ends of a line can make from a number: what arrives can be held against what was sent.

They look to a codec like matched maps do: slanted surfaces with sharp borders, some sub-pixel noise that neighbours share, a
strip with no match beside every border, and holes.
"""

from __future__ import annotations

from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap

__all__ = ["DIFFERENT", "numbered_map"]

DIFFERENT = 16  # the maps repeat after so many numbers
_SURFACES = 24
_WIDTH = 640  # of the map that these are meant for, in pixels
_NEAREST_PX, _FARTHEST_PX, _SLOPE_PX = 90.0, 4.0, 12.0
# So that a map costs what a matched one does: 0.9 bits a pixel within 1/16 px, 0.65 within 1/8, 0.4 within 1/4.
_NOISE_PX, _NOISE_SPREAD = 0.04, 1.3
_HOLES = 12
_WINDOW = DisparityWindow(128, -1.0, 5000.0)


@lru_cache(maxsize=2 * DIFFERENT)
def numbered_map(number: int, width: int, height: int) -> DisparityMap:
    """Make the map of a frame number: (height, width), the same on every machine that has the same numpy."""
    rng = np.random.default_rng([2010, number % DIFFERENT])
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    x, y = columns / width, rows / height
    centres = rng.random((_SURFACES, 2), np.float32)
    away = np.stack([(x - cx) ** 2 + (y - cy) ** 2 for cx, cy in centres])
    surface = np.argmin(away, axis=0)
    scale = np.float32(
        width / _WIDTH
    )  # half the width sees half the disparity; its noise falls less, as in matched maps
    base = scale * rng.uniform(_FARTHEST_PX, _NEAREST_PX, _SURFACES).astype(np.float32)
    slope = scale * rng.normal(0.0, _SLOPE_PX, (_SURFACES, 2)).astype(np.float32)
    disparity = base[surface] + slope[surface, 0] * (x - 0.5) + slope[surface, 1] * (y - 0.5)
    noise = rng.permutation(_NOISE_PX * np.exp(_NOISE_SPREAD * _spread_evenly(_SURFACES))).astype(np.float32)
    disparity += np.sqrt(scale) * noise[surface] * _shared_noise(rng, height, width)
    disparity = np.clip(disparity, 1 / 16, _WINDOW.labels - 1).astype(np.float32)
    disparity[_borders(surface, width // 80) | _holes(rng, x, y)] = np.nan
    steps = DisparityMap(disparity, _WINDOW).fixed_point()
    return DisparityMap.from_fixed_point(steps, _WINDOW)


def _spread_evenly(count: int) -> NDArray[np.float64]:
    """Give the quantiles of a normal distribution: every map has as much noise as the next, as frames of a video have."""
    normal = NormalDist()
    return np.array([normal.inv_cdf((place + 0.5) / count) for place in range(count)])


def _shared_noise(rng: np.random.Generator, height: int, width: int) -> NDArray[np.float32]:
    """Make noise of deviation 1 that neighbours have in common."""
    fine = rng.standard_normal((height + 2, width + 2), np.float32)
    shared = sum(fine[dy : dy + height, dx : dx + width] for dy in range(3) for dx in range(3)) / np.float32(3)
    return np.asarray(shared, np.float32)


def _borders(surface: NDArray[np.int64], reach: int) -> NDArray[np.bool_]:
    """Find the pixels at most `reach` to the left of another surface."""
    found = np.zeros(surface.shape, np.bool_)
    for step in range(1, reach + 1):
        found[:, :-step] |= surface[:, :-step] != surface[:, step:]
    return found


def _holes(rng: np.random.Generator, x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.bool_]:
    found = np.zeros(x.shape, np.bool_)
    for cx, cy, radius in rng.random((_HOLES, 3)):
        found |= (x - cx) ** 2 + (y - cy) ** 2 < (0.01 + 0.05 * radius) ** 2
    return found
