"""Matches set right in the full picture: a patch around each left point is laid over the right picture and moved until it fits.

The two views look at a thing from different sides, so the patch may be sheared and stretched as well as moved.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["registered"]

Array = NDArray[np.float64]

_PATCH_PX = 41  # a side of the patch
_BLUR_PX = 5  # a side of the Gaussian that both patches are smoothed by
_ROUNDS = 30
_LEAST_LIKENESS = 0.8  # correlation of the two patches once they lie over each other


def registered(
    left: NDArray[np.uint8], right: NDArray[np.uint8], left_points: Array, right_points: Array, reach_px: float
) -> tuple[Array, Array]:
    """Return the matches (N, 2) of two grey pictures with the right points moved to where the pictures agree.

    A match that would have to move farther than `reach_px`, or never agrees, or lies at the rim, is left out.
    """
    kept, moved = [], []
    for index, (a, b) in enumerate(zip(left_points, right_points, strict=True)):
        place = _register(left, right, a, b, reach_px)
        if place is not None:
            kept.append(index)
            moved.append(place)
    return left_points[kept], np.array(moved, float).reshape(-1, 2)


def _register(left: NDArray[np.uint8], right: NDArray[np.uint8], a: Array, b: Array, reach_px: float) -> Array | None:
    """Return where in the right picture the left point lies, None where that cannot be told."""
    half = _PATCH_PX // 2
    margin = half + int(np.ceil(reach_px)) + 2
    x, y = np.rint(b).astype(int)
    height, width = right.shape
    if not (margin <= x < width - margin and margin <= y < height - margin):
        return None
    if not (np.all(a >= half + 1) and np.all(a < np.array(left.shape[::-1]) - half - 1)):
        return None
    patch = cv2.getRectSubPix(left, (_PATCH_PX, _PATCH_PX), (float(a[0]), float(a[1])))
    around = right[y - margin : y + margin + 1, x - margin : x + margin + 1]
    start = b - np.array([x, y]) + margin  # of the patch's middle, in `around`
    warp = np.array([[1, 0, start[0] - half], [0, 1, start[1] - half]], np.float32)
    everywhere = np.ones(around.shape, np.uint8)
    try:
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, _ROUNDS, 1e-4)
        likeness, found = cv2.findTransformECC(patch, around, warp, cv2.MOTION_AFFINE, criteria, everywhere, _BLUR_PX)
    except cv2.error:  # flat patches, or a warp that ran away
        return None
    middle = np.asarray(found, float) @ np.array([half, half, 1.0])
    if likeness < _LEAST_LIKENESS or np.hypot(*(middle - start)) > reach_px:
        return None
    return np.asarray(middle - margin + np.array([x, y]))
