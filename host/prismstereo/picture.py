"""Pictures of depth that people can read: near is red, far is blue, unmatched is black, a scale with numbers beside it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap

__all__ = ["LEGEND_WIDTH", "Span", "depth_picture", "disparity_colours", "disparity_span"]

Span = tuple[float, float]

LEGEND_WIDTH = 92
_BAR_WIDTH = 16
_TICKS = 6
_LOW_PERCENT, _HIGH_PERCENT = 1.0, 99.0


def disparity_span(disparity: DisparityMap) -> Span:
    """Return the disparities that the colours reach over: what is there, less a hundredth of outliers at each end."""
    known = disparity.disparity_px[disparity.valid]
    if not known.size:
        return 0.0, float(disparity.window.labels)
    low, high = np.percentile(known, [_LOW_PERCENT, _HIGH_PERCENT])
    return float(low), float(max(high, low + 1.0))


def disparity_colours(disparity: DisparityMap, span: Span | None = None) -> NDArray[np.uint8]:
    """Paint a disparity map (height, width, 3) BGR in the turbo map over a `span` of disparities; unmatched is black.

    Without a span it is the map's own.
    """
    low, high = span or disparity_span(disparity)
    scaled = np.clip((np.nan_to_num(disparity.disparity_px) - low) / (high - low), 0, 1)
    painted = cv2.applyColorMap(np.rint(255 * scaled).astype(np.uint8), cv2.COLORMAP_TURBO)
    return np.where(disparity.valid[..., None], painted, 0).astype(np.uint8)


def depth_picture(disparity: DisparityMap, unit: str = "mm", span: Span | None = None) -> NDArray[np.uint8]:
    """Paint a disparity map with a scale of depths at its right: (height, width + 92, 3) BGR.

    A pair that is not metric gets a scale of disparities. Without a `span` of disparities the colours reach over the map's own.
    """
    low, high = span or disparity_span(disparity)
    picture = disparity_colours(disparity, (low, high))
    height = picture.shape[0]
    legend = np.full((height, LEGEND_WIDTH, 3), 24, np.uint8)
    ramp = np.linspace(255, 0, max(height - 24, 1)).astype(np.uint8)[:, None]
    bar = cv2.applyColorMap(np.repeat(ramp, _BAR_WIDTH, axis=1), cv2.COLORMAP_TURBO)
    legend[12 : 12 + len(bar), 6 : 6 + _BAR_WIDTH] = bar[: height - 12]
    for tick in range(_TICKS):
        share = tick / (_TICKS - 1)
        row = round(12 + share * max(len(bar) - 1, 0))
        value = high + share * (low - high)
        text, place = _label(disparity, value, unit), (26, row + 4)
        cv2.putText(legend, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.38, (230, 230, 230), 1, cv2.LINE_AA)
    return np.concatenate([picture, legend], axis=1)


def _label(disparity: DisparityMap, value_px: float, unit: str) -> str:
    if disparity.window.scale_px <= 0:
        return f"{value_px:.0f} px"
    depth = float(disparity.window.depth(np.array([value_px], np.float32))[0])
    if not math.isfinite(depth):
        return "far"
    if unit == "mm":
        return f"{depth:.0f} mm" if depth < 10_000 else f"{depth / 1000:.0f} m"
    return f"{depth:.1f} sq"
