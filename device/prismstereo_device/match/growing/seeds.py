"""Where growing begins: at corners that find a sure partner, at random, or at the matches of an earlier map."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.growing.growing_kernels import MARGIN_PX, NEVER, ONE, matched_along_rows
from prismstereo_device.match.growing.settings import GrowingSettings
from prismstereo_device.match.growing.windows import PaddedPair

__all__ = ["harris_corners", "harris_seeds", "map_seeds", "random_seeds"]

_HALF_PX = 3  # corners are matched by windows of 7x7
_BLOCK_PX, _SOBEL_PX, _HARRIS_K = 3, 3, 0.04
_MAP_STEP_PX = 4

Seeds = NDArray[np.int64]


def harris_corners(picture: NDArray[np.uint8], share: float) -> NDArray[np.int64]:
    """Return rows and columns (n, 2) of the strongest `share` of a grey picture's Harris corners, the strongest first."""
    response = np.asarray(cv2.cornerHarris(picture, _BLOCK_PX, _SOBEL_PX, _HARRIS_K))
    highest = np.asarray(cv2.dilate(response, np.ones((3, 3), np.uint8)))
    corners = np.argwhere((response == highest) & (response > 0))
    strength = response[corners[:, 0], corners[:, 1]]
    strongest = np.argsort(-strength, kind="stable")[: math.ceil(share * len(corners))]
    return np.asarray(corners[strongest], np.int64)


def harris_seeds(
    picture: NDArray[np.uint8], pair: PaddedPair, first: int, labels: int, settings: GrowingSettings
) -> Seeds:
    """Return rows, columns and disparities (n, 3) of the left picture's corners that correlate well with a right window."""
    corners = harris_corners(picture, settings.harris_share)
    windows = pair.windows(_HALF_PX, settings.noise_grey)
    places = (corners[:, 0] + MARGIN_PX) * pair.width + corners[:, 1] + MARGIN_PX
    disparities, correlations = matched_along_rows(
        pair.pictures, windows.sums, windows.powers, windows.floor, pair.width, _HALF_PX, first, labels, places
    )
    sure = (correlations > settings.seed_correlation * ONE) & (correlations > NEVER)
    return np.column_stack([corners, disparities])[sure]


def random_seeds(shape: tuple[int, int], first: int, labels: int, settings: GrowingSettings) -> Seeds:
    """Return rows, columns and disparities (n, 3) drawn over the whole search; those whose partner is outside are left out."""
    rng = np.random.default_rng(settings.random_seed)
    size = settings.random_seeds
    rows, columns = rng.integers(0, shape[0], size), rng.integers(0, shape[1], size)
    disparities = rng.integers(first, labels, size)
    return np.column_stack([rows, columns, disparities])[disparities <= columns]


def map_seeds(disparity_px: NDArray[np.float32], first: int, labels: int) -> Seeds:
    """Return rows, columns and disparities (n, 3) of every fourth row and column of a map (height, width), where matched."""
    thinned = disparity_px[::_MAP_STEP_PX, ::_MAP_STEP_PX]
    rows, columns = np.nonzero(np.isfinite(thinned))
    disparities = np.rint(thinned[rows, columns]).astype(np.int64)
    seeds = np.column_stack([rows * _MAP_STEP_PX, columns * _MAP_STEP_PX, disparities])
    return seeds[(disparities >= first) & (disparities < labels) & (disparities <= seeds[:, 1])]
