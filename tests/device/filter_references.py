"""The filters' kernels once more, in plain numpy and slow: what the compiled ones are compared with."""

from __future__ import annotations

import numpy as np

__all__ = ["closest", "filled_rows", "levelled", "median", "tolerance"]


def tolerance(value: float, reach: tuple[float, float, float, float]) -> float:
    most, least, share, offset = reach
    return min(most, max(least, share * (value + offset)))


def levelled(disparity: np.ndarray, radius: int, reach: tuple[float, float, float, float]) -> np.ndarray:
    padded = np.pad(disparity.astype(float), radius, constant_values=np.nan)
    out = disparity.astype(float)
    offsets = [(dy, dx) for dy in range(radius + 1) for dx in range(-radius, radius + 1) if dy or dx > 0]
    for y, x in np.argwhere(~np.isnan(disparity)):
        middle, kept = float(disparity[y, x]), [0.0]
        for dy, dx in offsets:
            pair = padded[[y + radius + dy, y + radius - dy], [x + radius + dx, x + radius - dx]] - middle
            if np.all(np.abs(pair) <= tolerance(middle, reach)):
                kept += list(pair)
        out[y, x] = middle + np.mean(kept)
    return out


def closest(disparity: np.ndarray, factor: int) -> np.ndarray:
    height, width = (-(-side // factor) for side in disparity.shape)
    out = np.full((height, width), np.nan, np.float32)
    for y, x in np.ndindex(height, width):
        block = disparity[y * factor : (y + 1) * factor, x * factor : (x + 1) * factor]
        if not np.isnan(block).all():
            out[y, x] = np.nanmax(block)
    return out


def filled_rows(disparity: np.ndarray, closed: np.ndarray, widest: int) -> np.ndarray:
    out = disparity.copy()
    for y, x in np.argwhere(np.isnan(disparity)):
        before, after = (np.flatnonzero(~np.isnan(part)) for part in (disparity[y, :x], disparity[y, x:]))
        if before.size and after.size:
            first, end = before[-1] + 1, x + after[0]
            if end - first <= widest and not closed[y, first:end].any():
                out[y, x] = min(disparity[y, first - 1], disparity[y, end])
    return out


def median(
    disparity: np.ndarray, weights: np.ndarray, middle: float, reach: tuple[float, float, float, float]
) -> float:
    """The weighted median of a window's matches, or `middle` where that is of the same surface."""
    order = np.argsort(disparity, kind="stable")
    upto = np.cumsum(weights[order])
    low = disparity[order][np.searchsorted(2 * upto, upto[-1])]
    high = disparity[order][np.searchsorted(2 * upto, upto[-1], side="right")]
    near = tolerance(middle, reach)
    return middle if np.float32(middle - near) <= low and high <= np.float32(middle + near) else low
