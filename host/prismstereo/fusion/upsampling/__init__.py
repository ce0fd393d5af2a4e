"""One low-resolution disparity map onto one still: `upsample`, and the methods behind it by name.

`edge-snap` is the default and the best; `geodesic` its reference; `joint-bilateral` the paper's formula; `weighted-mode` the
value most sites agree on. All are given the same map, guide and grid, and none sees more than that.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.flags import Flag
from prismstereo.fusion.upsampling.edge_snap import EdgeSnap
from prismstereo.fusion.upsampling.geodesic import geodesic
from prismstereo.fusion.upsampling.grid import Grid
from prismstereo.fusion.upsampling.upsampled import Upsampled
from prismstereo.fusion.upsampling.weighing import joint_bilateral, weighted_mode
from prismstereo_hw.errors import UsageError

__all__ = ["DEFAULT", "METHODS", "EdgeSnap", "Flag", "Grid", "Upsampled", "upsample"]

DEFAULT = "edge-snap"
METHODS = {
    "edge-snap": "Edges where the guide has them, decided cell by cell by votes of colour and a small net.",
    "votes": "The same without anything learned.",
    "geodesic": "The surface with the shortest way over the guide: slower, the reference of edge-snap.",
    "joint-bilateral": "The paper's weighted mean.",
    "weighted-mode": "The disparity that most of the weight of the sites around agrees on.",
}
_COLOURS = 3


def upsample(
    disparity_px: NDArray[np.float32],
    guide: NDArray[np.uint8],
    method: str = DEFAULT,
    *,
    grid: Grid | None = None,
    confidence: NDArray[np.float32] | None = None,
    fill: bool = True,
    threads: int = 2,
) -> Upsampled:
    """Upsample a map (h, w), pixels of its own, NaN for holes, to the size of its guide, (H, W) grey or (H, W, 3) BGR uint8.

    Without a grid the two show the same, and the scales are those of the sizes. `confidence` (h, w), 0 or more, is for the
    methods that weigh. Pixels that rest on a hole are flagged as filled; without `fill` they stay empty. `UsageError` for what
    does not go together.

    >>> flat = upsample(np.full((2, 3), 4.0, np.float32), np.zeros((4, 6), np.uint8))
    >>> flat.disparity_px.shape, float(flat.disparity_px.max())
    ((4, 6), 8.0)
    """
    _require(disparity_px, guide, method, confidence)
    low, high = (disparity_px.shape[0], disparity_px.shape[1]), (guide.shape[0], guide.shape[1])
    grid = Grid.between(low, high) if grid is None else grid
    if method in ("edge-snap", "votes"):
        planes = np.ascontiguousarray(guide if guide.ndim == _COLOURS else guide[:, :, None])
        snap = EdgeSnap(low, high, planes.shape[2], grid, threads=threads, learned=method == "edge-snap")
        done = snap.upsample(disparity_px, planes)
    else:
        grey = np.asarray(cv2.cvtColor(guide, cv2.COLOR_BGR2GRAY) if guide.ndim == _COLOURS else guide, np.uint8)
        grey = np.ascontiguousarray(grey)
        if method == "geodesic":
            done = geodesic(disparity_px, grey, grid, threads)
        else:
            weigh = joint_bilateral if method == "joint-bilateral" else weighted_mode
            done = weigh(disparity_px, grey, grid, confidence, threads)
    if not fill:
        done.disparity_px[(done.flags & Flag.FILLED) != 0] = np.nan
    return done


def _require(
    disparity_px: NDArray[np.float32], guide: NDArray[np.uint8], method: str, confidence: NDArray[np.float32] | None
) -> None:
    if method not in METHODS:
        raise UsageError(f"there is no method {method!r}: choose one of {', '.join(METHODS)}")
    if disparity_px.ndim != 2 or not disparity_px.size or disparity_px.dtype.kind != "f":
        raise UsageError(f"a disparity map is (height, width) float, not {disparity_px.dtype} {disparity_px.shape}")
    if (
        guide.dtype != np.uint8
        or guide.ndim not in (2, 3)
        or guide.shape[2:] not in ((), (_COLOURS,))
        or not guide.size
    ):
        raise UsageError(f"a guide is an 8-bit picture, grey or BGR, not {guide.dtype} {guide.shape}")
    if confidence is not None:
        if method not in ("joint-bilateral", "weighted-mode"):
            raise UsageError(
                f"{method} does not weigh by confidence: leave it out, or use joint-bilateral or weighted-mode"
            )
        if confidence.shape != disparity_px.shape:
            raise UsageError(
                f"confidence is {confidence.shape}, the map {disparity_px.shape}: give one number for each pixel"
            )
