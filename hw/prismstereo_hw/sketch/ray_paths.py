"""The way of a few rays of the middle row through a rig, from the entrance pupil to the scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError
from prismstereo_hw.optics.trace import trace
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

__all__ = ["RayPaths", "ray_paths"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RayPaths:
    """Rays of one view from its first to its last kept column.

    `points_mm` is (rays, surfaces + 1, 2), x and z from the pupil to the last surface; `direction` (rays, 2) leads on.
    """

    points_mm: Array
    direction: Array

    def at_depth(self, z_mm: float) -> Array:
        """Return x in mm (rays,) where the outgoing rays reach a depth in the rig frame."""
        last = self.points_mm[:, -1]
        return np.asarray(last[:, 0] + (z_mm - last[:, 1]) * self.direction[:, 0] / self.direction[:, 1])

    @property
    def viewpoint_mm(self) -> tuple[float, float]:
        """Where the first and the last outgoing ray come from: x and z of the virtual camera."""
        (x0, z0), (x1, z1) = self.points_mm[0, -1], self.points_mm[-1, -1]
        (u0, w0), (u1, w1) = self.direction[0], self.direction[-1]
        along = ((x1 - x0) * w1 - (z1 - z0) * u1) / (u0 * w1 - w0 * u1)
        return float(x0 + along * u0), float(z0 + along * w0)


def ray_paths(rig: Rig, side: Side, count: int = 3) -> RayPaths:
    """Trace `count` rays evenly spread over the columns of a view that are kept; `RigError` if there are none."""
    lens, video = rig.lens(), rig.camera.video
    x, _, w, _ = rig.views[0 if side == "left" else 1].rectangle(video.width, video.height)
    columns = np.arange(x, x + w, dtype=float)
    slopes = lens.slopes(np.stack([columns, np.full_like(columns, lens.cy_px)], axis=-1))
    inward = np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    surfaces = rig.surfaces(side)
    kept = np.flatnonzero(trace(surfaces, np.zeros(3), inward).fate == 0)
    if len(kept) < count:
        raise RigError(f"rig {rig.name!r} shows nothing in its {side} view: there are no rays to draw")
    chosen = inward[kept[np.linspace(0, len(kept) - 1, count).astype(int)]]
    ways = [trace(surfaces[:passed], np.zeros(3), chosen) for passed in range(1, len(surfaces) + 1)]
    points = [np.zeros((count, 3)), *(np.broadcast_to(way.point_mm, (count, 3)) for way in ways)]
    final = ways[-1].direction if ways else chosen
    return RayPaths(np.stack(points, axis=1)[..., [0, 2]], final[:, [0, 2]])
