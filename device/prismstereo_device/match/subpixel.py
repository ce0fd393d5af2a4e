"""Sub-pixel disparity by gradient least squares: shift the right picture until it lies on the left one.

Semi-global costs are nearly flat within half a pixel and their parabolas lean to whole pixels (pixel locking). Here each
window looks for the one disparity d that best explains its pixels, which were shifted by d_j each,
    g_j (d - d_j) = -r_j,   r = left - right(x - d_j),  g = slope along the row, means of the window taken off,
twice over: the method of Lucas and Kanade along epipolar rows. One disparity for all of them also levels the steps and
the speckle that the start brought along.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["refine"]

_WINDOW = 7
_ROUNDS = 2
_LARGEST_STEP_PX = 0.5
_LARGEST_TOTAL_PX = 0.75  # a whole-pixel start is half a pixel off at most; what moves on follows something else
_LEAST_SLOPE = 4.0  # mean squared grey levels per pixel; flatter windows keep the matcher's own value

Float = NDArray[np.float32]


def refine(left: NDArray[np.uint8], right: NDArray[np.uint8], disparity_px: Float, *, window: int = _WINDOW) -> Float:
    """Return the disparity (height, width) float32, refined by at most 0.75 px where that explains the pictures better.

    `left` and `right` are grey pictures (height, width); windows take in matched pixels alone; NaN stays NaN.
    """
    known = ~np.isnan(disparity_px)
    weight = known.astype(np.float32)
    columns, rows = np.meshgrid(np.arange(left.shape[1], dtype=np.float32), np.arange(left.shape[0], dtype=np.float32))
    grey, other = left.astype(np.float32), right.astype(np.float32)
    own_slope = _slope(grey)

    def shifted(by: Float) -> Float:
        seen = cv2.remap(other, columns - by, rows, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen, np.float32)

    refined = np.where(known, disparity_px, np.float32(0))
    seen = shifted(refined)
    unexplained = _covariance(grey - seen, grey - seen, weight, window)
    for _ in range(_ROUNDS):
        slope = np.float32(0.5) * (own_slope + _slope(seen))
        common = _common(refined, grey - seen, slope, weight, window)
        refined = refined + np.clip(common - refined, -_LARGEST_STEP_PX, _LARGEST_STEP_PX)
        seen = shifted(refined)
    better = _covariance(grey - seen, grey - seen, weight, window) < unexplained
    kept = better & (np.abs(refined - disparity_px) <= _LARGEST_TOTAL_PX)
    return np.where(known, np.maximum(np.where(kept, refined, disparity_px), np.float32(0)), np.float32(np.nan))


def _slope(grey: Float) -> Float:
    return np.asarray(cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]], np.float32)), np.float32)


def _common(disparity_px: Float, residual: Float, slope: Float, weight: Float, window: int) -> Float:
    """Return the one disparity of each pixel's window, or its own where the window is flat."""
    power = _covariance(slope, slope, weight, window)
    enough = power > _LEAST_SLOPE
    product = _covariance(slope, slope * disparity_px - residual, weight, window)
    return np.where(enough, product / np.where(enough, power, np.float32(1)), disparity_px)


def _covariance(a: Float, b: Float, weight: Float, window: int) -> Float:
    """Return the covariance (height, width) of two pictures over each pixel's window, by weight."""

    def mean(values: Float) -> Float:
        return np.asarray(cv2.boxFilter(values, cv2.CV_32F, (window, window)), np.float32)

    share = np.maximum(mean(weight), np.float32(1e-6))
    return np.asarray(mean(weight * a * b) / share - mean(weight * a) * mean(weight * b) / (share * share))
