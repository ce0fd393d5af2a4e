"""A box, turned as one likes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.shapes.culling import among_passing
from prismstereo_hw.shapes.pose import Motion, Pose, Vector
from prismstereo_hw.shapes.shape import NEAREST_MM, Array
from prismstereo_hw.texture import Texture

__all__ = ["Box", "through_slabs"]


def through_slabs(origin: Array, direction: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return where rays (N, 3) enter and leave the block low..high (3,), (N,) each; enter > leave where they miss it.

    Rays along a face count as inside when they start within its two planes.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - origin) / direction, (high - origin) / direction
    inside = (origin >= low) & (origin <= high)
    level = direction == 0
    enter = np.where(level, np.where(inside, -np.inf, np.inf), np.minimum(one, other))
    leave = np.where(level, np.where(inside, np.inf, -np.inf), np.maximum(one, other))
    return enter.max(axis=1), leave.min(axis=1)


@dataclass(frozen=True, slots=True)
class Box:
    """A box of half sizes in mm along the axes of its pose; one texture, another part of it on each of the six faces."""

    name: str
    pose: Pose
    half_mm: Vector
    texture: Texture
    motion: Motion = field(default_factory=Motion)

    def at(self, seconds: float) -> Box:
        """Return this box where it is at a time."""
        return replace(self, pose=self.pose.at(self.motion, seconds))

    def distance(self, origin: Array, direction: Array) -> Array:
        """Return how far along each ray (N, 3) the box is met, (N,) mm; from within, its far side; inf where it is not."""
        return among_passing(origin, direction, self.pose.centre_mm, math.hypot(*self.half_mm), self._distance)

    def _distance(self, origin: Array, direction: Array) -> Array:
        half = np.asarray(self.half_mm)
        enter, leave = through_slabs(self.pose.to_body(origin), self.pose.direction_to_body(direction), -half, half)
        reach = np.where(enter > NEAREST_MM, enter, leave)
        return np.where((enter <= leave) & (reach > NEAREST_MM), reach, np.inf)

    def _faces(self, body: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the axis (N,) of the face that each body point lies on, and its sign: 0 or 1."""
        axis = np.argmax(np.abs(body) - np.asarray(self.half_mm), axis=1)
        return axis, (body[np.arange(len(body)), axis] > 0).astype(np.intp)

    def shade(self, point: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at points (N, 3) of this surface, seen by pixels of a size (N,) in mm."""
        body = self.pose.to_body(point)
        axis, sign = self._faces(body)
        rows = np.arange(len(body))
        # faces side by side in the texture, a little apart
        along = 2.2 * max(self.half_mm) * (2 * axis + sign)
        return self.texture.shade(body[rows, axis - 2] + along, body[rows, axis - 1], pixel_mm)

    def normals(self, point: Array) -> Array:
        """Return outward unit normals (N, 3) at points (N, 3) of the box."""
        axis, sign = self._faces(self.pose.to_body(point))
        return self.pose.direction_to_rig(np.eye(3)[axis] * (2.0 * sign[:, None] - 1.0))
