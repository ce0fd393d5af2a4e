"""One pass over a disparity map: round it, drop what has no partner in the right picture or lies where a view is blind."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled

__all__ = ["settle"]

Seen = NDArray[np.bool_]


@compiled
def settle(disparity: NDArray[np.float32], left_seen: Seen, right_seen: Seen, fractions: np.float32) -> None:
    """Round disparities (height, width) to `fractions` steps a pixel, and make those NaN that nothing stands behind.

    A mask of one pixel (1, 1) stands for a view that is seen everywhere.
    """
    height, width = disparity.shape
    left_masked, right_masked = left_seen.size > 1, right_seen.size > 1
    for y in range(height):
        for x in range(width):
            found = disparity[y, x]
            if np.isnan(found):
                continue
            rounded = np.float32(np.rint(found * fractions) / fractions)
            partner = np.float32(x) - rounded
            kept = partner >= 0
            if kept and left_masked:
                kept = left_seen[y, x]
            if kept and right_masked:
                kept = right_seen[y, int(np.rint(partner))]
            disparity[y, x] = rounded if kept else np.float32(np.nan)
