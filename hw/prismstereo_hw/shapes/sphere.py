"""A ball."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from prismstereo_hw.shapes.pose import Motion, Pose
from prismstereo_hw.shapes.shape import NEAREST_MM, Array
from prismstereo_hw.shapes.triplanar import triplanar
from prismstereo_hw.texture import Texture

__all__ = ["Sphere"]


@dataclass(frozen=True, slots=True)
class Sphere:
    """A ball of a radius in mm about the centre of its pose; its texture turns with it."""

    name: str
    pose: Pose
    radius_mm: float
    texture: Texture
    motion: Motion = field(default_factory=Motion)

    def at(self, seconds: float) -> Sphere:
        """Return this ball where it is at a time."""
        return replace(self, pose=self.pose.at(self.motion, seconds))

    def distance(self, origin: Array, direction: Array) -> Array:
        """Return how far along each ray (N, 3) the ball is met, (N,) mm; from within, its far side; inf where it is not."""
        to_centre = self.pose.centre_mm - origin
        middle = np.einsum("ni,ni->n", to_centre, direction)  # where the ray is nearest to the centre
        aside = to_centre - middle[:, None] * direction  # and there, how far off: b^2 - c would cancel from afar
        half_chord = np.sqrt(np.maximum(self.radius_mm**2 - np.einsum("ni,ni->n", aside, aside), 0.0))
        met = half_chord > 0
        front, back = middle - half_chord, middle + half_chord
        reach = np.where(front > NEAREST_MM, front, back)
        return np.where(met & (reach > NEAREST_MM), reach, np.inf)

    def shade(self, point: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at points (N, 3) of this surface, seen by pixels of a size (N,) in mm."""
        body = self.pose.to_body(point)
        return triplanar(self.texture, body, body / self.radius_mm, pixel_mm)

    def normals(self, point: Array) -> Array:
        """Return outward unit normals (N, 3) at points (N, 3) of the ball."""
        outward = point - self.pose.centre_mm
        return np.asarray(outward / np.linalg.norm(outward, axis=1, keepdims=True))
