"""Compiled loop that draws triangles into a picture, nearest first: a z-buffer, no display."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled_any

__all__ = ["draw_triangles"]

Float = NDArray[np.float32]


@compiled_any
def draw_triangles(seen: Float, shades: Float, triangles: NDArray[np.uint32], depth: Float, picture: Float) -> None:
    """Draw triangles of corners `seen` (N, 3), column, row and depth, in `shades` (N, 3).

    `depth` (H, W), inf before, and `picture` (H, W, 3) are written where a triangle is nearer than what is there.
    """
    height, width = depth.shape
    for i in range(triangles.shape[0]):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        if seen[a, 2] <= 0 or seen[b, 2] <= 0 or seen[c, 2] <= 0:
            continue
        ax, ay, bx, by, cx, cy = seen[a, 0], seen[a, 1], seen[b, 0], seen[b, 1], seen[c, 0], seen[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0:
            continue
        left, right = max(math.ceil(min(ax, bx, cx)), 0), min(math.floor(max(ax, bx, cx)), width - 1)
        top, bottom = max(math.ceil(min(ay, by, cy)), 0), min(math.floor(max(ay, by, cy)), height - 1)
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1 - u - v
                if u < 0 or v < 0 or w < 0:
                    continue
                z = u * seen[a, 2] + v * seen[b, 2] + w * seen[c, 2]
                if z < depth[y, x]:
                    depth[y, x] = z
                    for k in range(3):
                        picture[y, x, k] = u * shades[a, k] + v * shades[b, k] + w * shades[c, k]
