"""A mesh over the pixels of one frame: neighbours make triangles, unless depth jumps between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.export.frames import ExportFrame

__all__ = ["GridMesh", "grid_mesh"]


@dataclass(frozen=True, slots=True)
class GridMesh:
    """Points (N, 3) float32 of the left optical frame in metres, their places (N, 2) in the picture, triangles (M, 3).

    Places run from 0 to 1, from the picture's upper left corner. Triangles go counter-clockwise as the camera sees them.
    """

    points_m: NDArray[np.float32]
    texture: NDArray[np.float32]
    triangles: NDArray[np.uint32]


def grid_mesh(frame: ExportFrame, jump: float = 0.05) -> GridMesh:
    """Join the pixels of a frame; no triangle spans depths that differ by more than `jump` of the nearest of them."""
    geometry = frame.geometry
    depth = frame.depth
    known = np.isfinite(depth)
    number = np.arange(depth.size, dtype=np.uint32).reshape(depth.shape)
    upper_left, upper_right = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    lower_left, lower_right = number[1:, :-1].ravel(), number[1:, 1:].ravel()
    triangles = np.concatenate(
        [
            np.stack([upper_left, lower_left, upper_right], axis=-1),
            np.stack([upper_right, lower_left, lower_right], axis=-1),
        ]
    )
    corners = np.where(known, depth, np.float32(np.inf)).ravel()[triangles]
    nearest, farthest = corners.min(axis=1), corners.max(axis=1)
    triangles = triangles[np.isfinite(farthest) & (farthest <= np.float32(1 + jump) * nearest)]
    used, renumbered = np.unique(triangles, return_inverse=True)
    points = geometry.points(np.where(known, depth, np.float32(0))).reshape(-1, 3)[used] * geometry.metres
    rows, columns = np.divmod(used, np.uint32(geometry.width))
    texture = np.stack([(columns + 0.5) / geometry.width, (rows + 0.5) / geometry.height], axis=-1)
    return GridMesh(points.astype(np.float32), texture.astype(np.float32), renumbered.reshape(-1, 3).astype(np.uint32))
