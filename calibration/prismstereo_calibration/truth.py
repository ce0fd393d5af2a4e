"""The twin's truth in rectified pixels: what a perfect matcher would find on a calibration's rectified pair."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.rectification import Rectification
from prismstereo_hw.twin import Truth

__all__ = ["true_disparity"]

_JUMP = 0.02  # relative depth step between neighbours that is an edge: nothing is interpolated across


def true_disparity(truth: Truth, rectification: Rectification) -> NDArray[np.float32]:
    """Return the true disparity (height, width) float32 of a rectified pair, NaN where no match exists.

    The raw right-view pixel of every raw left-view pixel is known exactly; both are rectified, and their difference
    interpolated at the rectified left pixel.
    """
    left, right = rectification.left, rectification.right
    source = rectification.sources(left).astype(np.float64)
    h, w = truth.depth_mm.shape
    inside = np.isfinite(source[..., 0]) & (source[..., 0] < w - 1) & (source[..., 1] < h - 1)
    at = source[inside]
    corner = np.floor(at).astype(np.int64)
    part = at - corner
    match, depth = np.zeros((len(at), 2)), np.zeros((4, len(at)))
    for index, (dx, dy) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        x, y = corner[:, 0] + dx, corner[:, 1] + dy
        weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
        match += weight[:, None] * truth.match_px[y, x]
        depth[index] = np.where(np.isfinite(truth.match_px[y, x, 0]), truth.depth_mm[y, x], np.nan)
    smooth = np.ptp(depth, axis=0) < _JUMP * depth.min(axis=0)  # NaN compares as False: a missing corner is an edge
    upright = right.view.upright_from_raw(match, rectification.frame_width, rectification.frame_height)
    rows, columns = np.nonzero(inside)
    disparity = np.full(inside.shape, np.nan, np.float32)
    found = columns - rectification.rectify(upright, right)[:, 0]
    disparity[rows, columns] = np.where(smooth, found, np.nan)
    return disparity
