"""How noisy the disparities of a map are, pixel by pixel, read from the map itself.

Over a few pixels the disparity of a surface is nearly linear, so what a pixel is off the middle of two neighbours, one at
either side, is noise; its mean size in a window tells one standard deviation. Where the matcher tells how clear each match was,
the clear ones get less of it: on the twin's face the error falls with the cube root of the confidence, from 0.071 px at 35 to
0.044 px at 140. The step on the wire comes on top. What shifts a whole neighbourhood, as at the border of a nearer thing,
cannot be seen.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.measuring.fix import ROUNDING_PX
from prismstereo_calibration.judging.uncertainty_map import MATCHING_NOISE_PX

__all__ = ["disparity_sigma"]

Float = NDArray[np.float32]

_REACH = 5  # pixels to the neighbours: as far as a matcher's windows reach, nearer ones share their noise
_SAME_SURFACE_PX = 2.0  # bend that no noise of one surface makes
_WINDOW = 9
_ALIKE = 2.5  # times: noise of both ways, where no step of depth is near
_FEWEST = 12  # bends in a window that tell a noise
_SIGMA_OF_BEND = 1 / (math.sqrt(6) * math.sqrt(2 / math.pi))  # of a - 2 b + c: variance 6, mean size sqrt(2 / pi)
_LOW, _HIGH = 0.5, 3.0  # bounds of what the confidence may change


def disparity_sigma(disparity_px: Float, confidence: NDArray[np.uint8] | None = None) -> Float:
    """Return one standard deviation of each disparity (height, width) float32 px, NaN where the map has none.

    `confidence` (height, width) uint8 is the matcher's, 0 where it says nothing.
    """
    known = np.isfinite(disparity_px)
    if not known.any():
        return np.full(disparity_px.shape, np.nan, np.float32)
    across, down = _along_rows(disparity_px), _along_rows(disparity_px.T).T
    low = np.minimum(across, down)
    sigma = np.where(np.maximum(across, down) <= _ALIKE * low, (across + down) / 2, low)  # a step bends one way only
    sigma = np.where(np.isfinite(sigma), sigma, np.float32(MATCHING_NOISE_PX))
    if confidence is not None:
        sigma = sigma * _unclear(confidence)
    sigma = np.sqrt(sigma * sigma + np.float32(ROUNDING_PX**2))
    return np.where(known, sigma, np.float32(np.nan)).astype(np.float32)


def _along_rows(values: Float) -> Float:
    """Return one sigma from the bends along rows around every pixel (height, width); inf where too few of them tell."""
    sizes, counts = np.zeros((2, *values.shape), np.float32)
    if values.shape[1] > 2 * _REACH:
        middle = (slice(None), slice(_REACH, -_REACH))
        bend = np.abs(values[:, : -2 * _REACH] - 2 * values[middle] + values[:, 2 * _REACH :])
        good = bend < _SAME_SURFACE_PX  # NaN is not
        sizes[middle], counts[middle] = np.where(good, bend, np.float32(0)), good
    many = _box(counts)
    told = _box(sizes) / np.maximum(many, 1) * np.float32(_SIGMA_OF_BEND)
    return np.where(many >= _FEWEST, told, np.float32(np.inf))


def _unclear(confidence: NDArray[np.uint8]) -> Float:
    """Return by how much a match is noisier than those around it (height, width) float32; 1 where nothing is said."""
    said = (confidence > 0).astype(np.float32)
    around = _box(confidence.astype(np.float32)) / np.maximum(_box(said), 1)
    ratio = np.where(said > 0, around / np.maximum(confidence, 1), np.float32(1))
    return np.clip(np.cbrt(ratio), _LOW, _HIGH).astype(np.float32)


def _box(values: Float) -> Float:
    return np.asarray(
        cv2.boxFilter(values, -1, (_WINDOW, _WINDOW), normalize=False, borderType=cv2.BORDER_CONSTANT), np.float32
    )
