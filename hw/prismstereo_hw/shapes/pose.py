"""Where a rigid thing stands, and how it moves on: straight, at a constant pace, spinning about an axis of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from prismstereo_hw.shapes.shape import Array

__all__ = ["Motion", "Pose"]

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Motion:
    """A constant velocity, and a constant spin about an axis through the centre that goes along.

    `spin_deg_s` is the axis times the rate, in the rig frame: (0, 0, 90) is a quarter turn a second that takes x to y.
    """

    velocity_mm_s: Vector = (0.0, 0.0, 0.0)
    spin_deg_s: Vector = (0.0, 0.0, 0.0)

    def shift_mm(self, seconds: float) -> Array:
        """Return how far the centre has moved (3,)."""
        return seconds * np.asarray(self.velocity_mm_s, np.float64)

    def turn(self, seconds: float) -> Array:
        """Return the rotation (3, 3) that has been made: Rodrigues' formula."""
        rate = math.hypot(*self.spin_deg_s)
        if not rate:
            return np.eye(3)
        x, y, z = np.asarray(self.spin_deg_s) / rate
        angle = math.radians(rate * seconds)
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.asarray(np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * (K @ K))


@dataclass(frozen=True, slots=True)
class Pose:
    """The frame of a body: X_rig = R X_body + centre, R (3, 3) a rotation, centre (3,) in mm."""

    centre_mm: Array
    R: Array = field(default_factory=lambda: np.eye(3))

    def at(self, motion: Motion, seconds: float) -> Pose:
        """Return this pose after it has moved for some seconds."""
        return Pose(self.centre_mm + motion.shift_mm(seconds), motion.turn(seconds) @ self.R)

    def to_body(self, points: Array) -> Array:
        """Take points (N, 3) of the rig frame into the body's."""
        return np.asarray((points - self.centre_mm) @ self.R)

    def direction_to_body(self, directions: Array) -> Array:
        """Take directions (N, 3) of the rig frame into the body's."""
        return np.asarray(directions @ self.R)

    def direction_to_rig(self, directions: Array) -> Array:
        """Take directions (N, 3) of the body into the rig frame."""
        return np.asarray(directions @ self.R.T)
