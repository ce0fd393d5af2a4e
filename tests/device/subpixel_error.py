"""How true the fractions of a pixel are: error of the inliers, pixel locking, and the semi-global anchor to compare with."""

from __future__ import annotations

import numpy as np

from prismstereo_device.rectify import RectifiedPair
from sgbm_anchor import sgbm_anchor

__all__ = ["inliers", "locking_px", "rms_px", "semi_global_steps"]


def semi_global_steps(pair: RectifiedPair) -> np.ndarray:
    """OpenCV's semi-global map in sixteenths, with the settings that all comparisons use."""
    return np.asarray(sgbm_anchor(pair.window.labels).compute(pair.left, pair.right), np.int16)


def inliers(steps: np.ndarray, truth_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N,) of the matches that are within a pixel of the truth, and the truth there, in pixels."""
    judged = (steps >= 0) & np.isfinite(truth_px)
    error = steps[judged] / 16 - truth_px[judged].astype(float)
    kept = np.abs(error) <= 1
    return error[kept], truth_px[judged][kept].astype(float)


def rms_px(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def locking_px(error: np.ndarray, truth_px: np.ndarray) -> float:
    """Amplitude of the first harmonic of the mean error over the fraction of the true disparity."""
    return float(2 * np.abs(np.mean(error * np.exp(-2j * np.pi * truth_px))))
