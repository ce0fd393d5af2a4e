"""How wrong an upsampled map is near depth edges, as the documents count it.

An edge is where the truth jumps by more than 3 px between neighbours. Counted are pixels within 8 px of an edge, 16 px off
the border, of known truth, in percent that are wrong by more than one low-resolution pixel (`edge_percent`); `beyond_percent`
leaves out the two pixels on either side of the jump itself; `edge_one_percent` counts what is wrong by more than 1 px.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["EdgeScores", "edge_distance_px", "point_sampled", "score"]

Float = NDArray[np.float32]
_JUMP_PX = 3.0
_REACH_PX = 8.0
_BESIDE_PX = 1.5  # the pixels of a jump are 0 away from it, their neighbours 1
_BORDER_PX = 16


@dataclass(frozen=True, slots=True)
class EdgeScores:
    """Percentages near edges, and the mean absolute error (px) near edges and everywhere."""

    edge_percent: float
    beyond_percent: float
    edge_one_percent: float
    edge_mean_px: float
    mean_px: float


def point_sampled(truth: Float, scale: float) -> tuple[Float, float, float]:
    """Return the truth (H, W) at low-resolution pixel centres, in low-resolution pixels, and the scales in x and y."""
    high, wide = truth.shape
    low = round(high / scale), round(wide / scale)
    scale_y, scale_x = high / low[0], wide / low[1]
    rows = np.clip(np.rint((np.arange(low[0]) + 0.5) * scale_y - 0.5).astype(int), 0, high - 1)
    columns = np.clip(np.rint((np.arange(low[1]) + 0.5) * scale_x - 0.5).astype(int), 0, wide - 1)
    return (truth[rows][:, columns] / scale_x).astype(np.float32), scale_x, scale_y


def edge_distance_px(truth: Float) -> Float:
    """Return how far (px) each pixel is from the nearest jump of the truth (H, W), NaN where that is unknown."""
    jump = np.zeros(truth.shape, np.uint8)
    down, across = (np.abs(np.diff(truth, axis=axis)) > _JUMP_PX for axis in (0, 1))
    jump[1:] |= down
    jump[:-1] |= down
    jump[:, 1:] |= across
    jump[:, :-1] |= across
    return np.asarray(cv2.distanceTransform(1 - jump, cv2.DIST_L2, 5), np.float32)


def score(found: Float, truth: Float, scale: float, distance_px: Float | None = None) -> EdgeScores:
    """Score a map against the truth, both (H, W) in pixels of their own; what is missing counts as disparity 0."""
    distance = edge_distance_px(truth) if distance_px is None else distance_px
    known = np.isfinite(truth)
    known[:_BORDER_PX] = known[-_BORDER_PX:] = False
    known[:, :_BORDER_PX] = known[:, -_BORDER_PX:] = False
    wrong = np.abs(np.nan_to_num(found) - np.where(known, truth, 0))
    edge = known & (distance <= _REACH_PX)
    beyond = edge & (distance > _BESIDE_PX)
    return EdgeScores(
        edge_percent=100 * float((wrong[edge] > scale).mean()),
        beyond_percent=100 * float((wrong[beyond] > scale).mean()),
        edge_one_percent=100 * float((wrong[edge] > 1).mean()),
        edge_mean_px=float(wrong[edge].mean()),
        mean_px=float(wrong[known].mean()),
    )
