"""Compiled decision why each pixel is unmatched."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled
from prismstereo_device.reasons import Reason

__all__ = ["decide", "spread"]

Byte = NDArray[np.uint8]

_MATCHED, _UNMATCHED, _OUTSIDE = int(Reason.MATCHED), int(Reason.UNMATCHED), int(Reason.OUTSIDE)
_SATURATED, _DARK, _WEAK_TEXTURE = int(Reason.SATURATED), int(Reason.DARK), int(Reason.WEAK_TEXTURE)
_HALF = 127  # of a window's pixels, as the mean of 0 and 255


@compiled
def decide(
    disparity: NDArray[np.float32],
    told: Byte,
    certain: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    static: Byte,
    clipped: Byte,
    level: Byte,
    dark: int,
    power: Byte,
    least_power: float,
    reasons: Byte,
    unexplained: NDArray[np.bool_],
) -> int:
    """Write the `reasons` (height, width) of the unmatched pixels, and return how many of them the picture does not explain.

    Those are marked `unexplained`, and have what was `told` of them. `certain` (256,) says which codes
    nothing measured overrides.
    `clipped`, `level` and `power` are means over each pixel's window: of 255 where saturated, grey level, and squared step.
    """
    height, width = disparity.shape
    count = 0
    for y in range(height):
        for x in range(width):
            if not np.isnan(disparity[y, x]):
                reasons[y, x] = _MATCHED
                continue
            said = int(told[y, x])
            if static[y, x] != 0:
                reasons[y, x] = static[y, x]
            elif not seen[y, x]:
                reasons[y, x] = _OUTSIDE
            elif certain[said]:
                reasons[y, x] = said
            elif clipped[y, x] > _HALF:
                reasons[y, x] = _SATURATED
            elif level[y, x] < dark:
                reasons[y, x] = _DARK
            elif power[y, x] < least_power:
                reasons[y, x] = _WEAK_TEXTURE
            else:
                reasons[y, x] = _UNMATCHED if said == _MATCHED else said
                unexplained[y, x] = True
                count += 1
    return count


@compiled
def spread(small: Byte, columns: int, rows: int, unexplained: NDArray[np.bool_], reasons: Byte) -> None:
    """Write what `small` says other than 0, one pixel for `columns` x `rows`, to the `unexplained` pixels of `reasons`.

    The large pictures (height, width) may have a rim that the small one has no pixels for: it is as the last ones are.
    """
    height, width = reasons.shape
    for v in range(small.shape[0]):
        bottom = height if v == small.shape[0] - 1 else (v + 1) * rows
        for u in range(small.shape[1]):
            if small[v, u] == 0:
                continue
            right = width if u == small.shape[1] - 1 else (u + 1) * columns
            for y in range(v * rows, bottom):
                for x in range(u * columns, right):
                    if unexplained[y, x]:
                        reasons[y, x] = small[v, u]
