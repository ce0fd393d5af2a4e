"""The rectification as the camera's warp engine takes it: a crop of the raw frame, and a mesh of points in there.

The engine interpolates between nodes linearly. On the built-in rigs, lens and prism glass included, nodes 16 pixels apart leave
at most 0.03 pixels of our own maps. A mirrored or turned view needs nothing more: its mesh runs the other way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.rectification import Rectification, RectifiedView
from prismstereo_hw.errors import UsageError

__all__ = ["MESH_STEP_PX", "ViewMesh"]

MESH_STEP_PX = 16
_FAR_OUTSIDE_PX = 4096.0  # a node that sees nothing points there: any real number outside will do


@dataclass(frozen=True, slots=True)
class ViewMesh:
    """`crop` is x, y, width, height in raw-frame pixels; `nodes` (rows, columns, 2) float32 are points (x, y) of the crop.

    Node (i, j) belongs to rectified pixel (j * step_x_px, i * step_y_px); the last ones lie one step behind the last pixel's
    cell, at (width, height).
    """

    crop: tuple[int, int, int, int]
    nodes: NDArray[np.float32]
    step_x_px: int
    step_y_px: int

    @classmethod
    def of(cls, made: Rectification, side: RectifiedView) -> ViewMesh:
        """Sample a rectification; `UsageError` for a view that is not one rectangle of one exposure."""
        view = side.view
        if view.row_step != 1 or view.exposures != 1:
            raise UsageError(
                "a view of interlaced rows or of an exposure of its own cannot be cut out by the camera: use mode=capture"
            )
        step_y = math.gcd(made.height, MESH_STEP_PX)
        columns, rows = np.meshgrid(
            np.arange(0, made.width + 1, MESH_STEP_PX, dtype=float), np.arange(0, made.height + 1, step_y, dtype=float)
        )
        depth = np.full(columns.shape, made.exact_at)
        upright = side.camera.project(made.points_at(np.stack([columns, rows], axis=-1), depth, side))
        frame = made.frame_width, made.frame_height
        x, y, w, h = view.rectangle(*frame)
        nodes = view.raw_from_upright(upright, *frame) - np.array([x, y])
        nodes = np.clip(np.nan_to_num(nodes, nan=-_FAR_OUTSIDE_PX), -_FAR_OUTSIDE_PX, _FAR_OUTSIDE_PX)
        return cls((x, y, w, h), nodes.astype(np.float32), MESH_STEP_PX, step_y)

    @property
    def columns(self) -> int:
        """Nodes in a row."""
        return int(self.nodes.shape[1])

    @property
    def rows(self) -> int:
        """Rows of nodes."""
        return int(self.nodes.shape[0])

    def points(self) -> list[tuple[float, float]]:
        """Return the nodes (x, y) row by row, as `Warp.setWarpMesh` takes them."""
        return [(float(x), float(y)) for x, y in self.nodes.reshape(-1, 2)]

    def dense(self) -> NDArray[np.float32]:
        """Return where the engine then looks for every rectified pixel, (height, width, 2) in pixels of the crop."""
        rows, down = _cells(self.rows, self.step_y_px)
        columns, along = _cells(self.columns, self.step_x_px)
        v, u = down[:, None, None], along[None, :, None]
        top = (1 - u) * self.nodes[rows][:, columns] + u * self.nodes[rows][:, columns + 1]
        bottom = (1 - u) * self.nodes[rows + 1][:, columns] + u * self.nodes[rows + 1][:, columns + 1]
        return np.asarray((1 - v) * top + v * bottom, np.float32)


def _cells(nodes: int, step_px: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return, for every pixel along one axis, the node before it and how far it has got to the next one, 0..1."""
    pixels = np.arange((nodes - 1) * step_px)
    return pixels // step_px, (pixels % step_px) / step_px
