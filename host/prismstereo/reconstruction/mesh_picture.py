"""A picture of a mesh from beside the camera, drawn without a display."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.reconstruction.mesh import Mesh
from prismstereo.reconstruction.raster_kernels import draw_triangles

__all__ = ["Sight", "mesh_picture"]

Float = NDArray[np.float32]

_LIGHT = np.array([-0.45, -0.6, -0.66], np.float32)  # from the upper left, behind the camera
_AMBIENT = 0.35
_PLAIN = 0.8  # share of white of a mesh without colours
_GROUND = 28.0  # grey behind the mesh


@dataclass(frozen=True, slots=True)
class Sight:
    """Where a mesh is looked at from: turned about a point straight ahead at `depth`, through a pinhole of its own grid.

    `focal_px`, `cx_px`, `cy_px` are those of pictures of `width` x `height`.
    """

    width: int
    height: int
    focal_px: float
    cx_px: float
    cy_px: float
    depth: float

    @classmethod
    def onto(cls, mesh: Mesh, width: int = 640, height: int = 480) -> Sight:
        """Look at all of a mesh, so that it fills nine tenths of a picture."""
        if not len(mesh.points):
            return cls(width, height, float(width), (width - 1) / 2, (height - 1) / 2, 1.0)
        slopes = mesh.points[:, :2] / mesh.points[:, 2:]
        low, high = np.percentile(slopes, 1, axis=0), np.percentile(slopes, 99, axis=0)
        spans = np.maximum(high - low, 1e-6)
        focal = 0.9 * min(width / float(spans[0]), height / float(spans[1]))
        middle = (low + high) / 2
        cx, cy = (width - 1) / 2 - focal * float(middle[0]), (height - 1) / 2 - focal * float(middle[1])
        return cls(width, height, focal, cx, cy, float(np.median(mesh.points[:, 2])))

    def pixels(self, points: Float, yaw_deg: float, pitch_deg: float) -> Float:
        """Return column, row and depth (N, 3) of points (N, 3), seen from so far to the right and above."""
        a, b = math.radians(yaw_deg), math.radians(pitch_deg)
        yaw = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
        pitch = np.array([[1, 0, 0], [0, math.cos(b), math.sin(b)], [0, -math.sin(b), math.cos(b)]])
        x = ((self.width - 1) / 2 - self.cx_px) / self.focal_px
        y = ((self.height - 1) / 2 - self.cy_px) / self.focal_px
        about = self.depth * np.array([x, y, 1.0])
        turned = (points - about) @ (pitch @ yaw).T + about
        ahead = np.where(turned[:, 2] > 0, turned[:, 2], 1.0)
        seen = np.empty((len(points), 3), np.float32)
        seen[:, 0] = self.focal_px * turned[:, 0] / ahead + self.cx_px
        seen[:, 1] = self.focal_px * turned[:, 1] / ahead + self.cy_px
        seen[:, 2] = turned[:, 2]
        return seen


def mesh_picture(
    mesh: Mesh, sight: Sight, *, yaw_deg: float = 20.0, pitch_deg: float = 10.0, plain: bool = False
) -> NDArray[np.uint8]:
    """Draw a mesh, (height, width, 3) uint8 BGR, lit from the upper left; `plain` leaves its colours out."""
    depth = np.full((sight.height, sight.width), np.inf, np.float32)
    picture = np.full((sight.height, sight.width, 3), _GROUND, np.float32)
    lit = _AMBIENT + (1 - _AMBIENT) * np.clip(mesh.normals @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
    colours = np.full((len(mesh.points), 3), 255 * _PLAIN) if plain or mesh.colours is None else mesh.colours[:, ::-1]
    shades = np.ascontiguousarray(colours * lit[:, None], np.float32)
    draw_triangles(sight.pixels(mesh.points, yaw_deg, pitch_deg), shades, mesh.triangles, depth, picture)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)
