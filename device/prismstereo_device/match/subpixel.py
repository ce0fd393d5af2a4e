"""Sub-pixel disparity by gradient least squares: shift the right picture until it lies on the left one.

Semi-global costs are nearly flat within half a pixel and their parabolas lean to whole pixels (pixel locking). Here the
disparity of each window is moved by the step that best explains what is left of the grey-level difference,
    step = -sum(g r) / sum(g g),   r = left - right(x - d),  g = slope along the row, means of the window taken off,
a few times over: the method of Lucas and Kanade along epipolar rows.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["refine"]

_WINDOW = 7
_ROUNDS = 3
_LARGEST_STEP_PX = 0.5
_LARGEST_TOTAL_PX = 1.0
_LEAST_SLOPE = 4.0  # mean squared grey levels per pixel; flatter windows keep the matcher's own value

Float = NDArray[np.float32]


def refine(left: NDArray[np.uint8], right: NDArray[np.uint8], disparity_px: Float, *, window: int = _WINDOW) -> Float:
    """Return the disparity (height, width) float32 refined by at most one pixel; NaN stays NaN.

    `left` and `right` are grey pictures (height, width); windows take in matched pixels alone.
    """
    known = ~np.isnan(disparity_px)
    weight = known.astype(np.float32)
    start = np.where(known, disparity_px, np.float32(0))
    columns, rows = np.meshgrid(np.arange(left.shape[1], dtype=np.float32), np.arange(left.shape[0], dtype=np.float32))
    grey, other = left.astype(np.float32), right.astype(np.float32)
    own_slope = _slope(grey)
    refined = start
    for _ in range(_ROUNDS):
        seen = cv2.remap(other, columns - refined, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        shifted = np.asarray(seen, np.float32)
        step = _step(grey - shifted, np.float32(0.5) * (own_slope + _slope(shifted)), weight, window)
        refined = refined + np.clip(step, -_LARGEST_STEP_PX, _LARGEST_STEP_PX)
        refined = np.clip(refined, start - _LARGEST_TOTAL_PX, start + _LARGEST_TOTAL_PX)
    return np.where(known, np.maximum(refined, np.float32(0)), np.float32(np.nan))


def _slope(grey: Float) -> Float:
    return np.asarray(cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]], np.float32)), np.float32)


def _step(residual: Float, slope: Float, weight: Float, window: int) -> Float:
    def mean(values: Float) -> Float:
        return np.asarray(cv2.boxFilter(values, cv2.CV_32F, (window, window)), np.float32)

    share = np.maximum(mean(weight), np.float32(1e-6))
    weighted = slope * weight
    mean_slope, mean_residual = mean(weighted) / share, mean(residual * weight) / share
    product = mean(weighted * residual) / share - mean_slope * mean_residual
    power = mean(weighted * slope) / share - mean_slope**2
    enough = power > _LEAST_SLOPE
    return np.where(enough, -product / np.where(enough, power, np.float32(1)), np.float32(0))
