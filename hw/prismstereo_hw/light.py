"""Light from afar: an even share from everywhere, the rest from a small bright disc, which may be hidden.

Shadows are those of an area light seen as a few seeded points of its disc, the same for every surface point: the two views
therefore see one and the same shadow, with as many steps from dark to bright as there are points.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from prismstereo_hw.errors import UsageError
from prismstereo_hw.shapes.pose import Vector
from prismstereo_hw.shapes.shape import Array

__all__ = ["Light"]

_GOLDEN_TURN = math.pi * (3 - math.sqrt(5))
_LIFT_MM = 1e-3  # off the surface before looking at the light,
_LIFT_SHARE = 1e-6  # and per mm from the origin, as rounding grows with it


@dataclass(frozen=True, slots=True)
class Light:
    """A light at infinity in the direction `towards` (rig frame, any length), and an `ambient` share 0..1 of its strength.

    Its level is strength (1 + swing sin(2 pi seconds / period_s)): a lamp or a cloud. `shadow_rays` (0: no shadows) points
    are taken of a disc that is `radius_deg` in radius; `seed` turns them. `UsageError` for numbers that are no light.
    """

    towards: Vector
    ambient: float = 0.4
    strength: float = 1.15
    swing: float = 0.0
    period_s: float = 20.0
    shadow_rays: int = 0
    radius_deg: float = 3.0
    seed: int = 1
    seconds: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what cannot shine."""
        if not (0 < math.hypot(*self.towards) < math.inf):
            raise UsageError(f"light towards {self.towards}: give a direction, not all zero")
        if not (0 <= self.ambient <= 1 and 0 <= self.swing <= 1 and self.strength >= 0 and self.period_s > 0):
            raise UsageError(
                f"light of ambient {self.ambient:g}, swing {self.swing:g}, strength {self.strength:g}, period_s "
                f"{self.period_s:g}: ambient and swing are 0 to 1, strength is not negative, the period is positive"
            )
        if not (0 <= self.shadow_rays <= 256 and 0 <= self.radius_deg < 45):
            raise UsageError(
                f"light of {self.shadow_rays} shadow rays over {self.radius_deg:g} degrees: give 0 to 256 over less than 45"
            )

    def at(self, seconds: float) -> Light:
        """Return the light some seconds later."""
        return replace(self, seconds=self.seconds + seconds)

    @property
    def level(self) -> float:
        """How bright it is at its time."""
        return self.strength * (1 + self.swing * math.sin(2 * math.pi * self.seconds / self.period_s))

    def points(self) -> Array:
        """Return unit directions (max(shadow_rays, 1), 3) towards the points of the disc that are looked at."""
        axis = np.asarray(self.towards, np.float64) / math.hypot(*self.towards)
        if not self.shadow_rays:
            return axis[None]
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side /= np.linalg.norm(side)
        place = np.arange(self.shadow_rays)
        # a sunflower: even over the disc
        radius = math.tan(math.radians(self.radius_deg)) * np.sqrt((place + 0.5) / self.shadow_rays)
        angle = np.random.default_rng(self.seed).uniform(0, 2 * math.pi) + place * _GOLDEN_TURN
        spread = np.outer(radius * np.cos(angle), side) + np.outer(radius * np.sin(angle), np.cross(axis, side))
        return np.asarray((axis + spread) / np.linalg.norm(axis + spread, axis=1, keepdims=True))

    def share(self, point: Array, normal: Array, sight: Array, reaches: Callable[[Array, Array], Array]) -> Array:
        """Return what multiplies the grey (N,) of points (N, 3) with unit normals (N, 3), seen along rays `sight` (N, 3).

        Lambert's law on the side that is seen. `reaches` tells how far rays (N, 3), (N, 3) get before they meet something.
        """
        facing = np.where(np.einsum("ni,ni->n", normal, sight) > 0, -1.0, 1.0)
        normal = facing[:, None] * normal
        lift = _LIFT_MM + _LIFT_SHARE * np.linalg.norm(point, axis=1)
        start = point + lift[:, None] * normal
        points = self.points()
        direct = np.zeros(len(point))
        for towards in points:
            slant = normal @ towards
            lit = slant > 0
            if self.shadow_rays and lit.any():
                lit[lit] = np.isinf(reaches(start[lit], np.broadcast_to(towards, (int(lit.sum()), 3))))
            direct += np.where(lit, slant, 0.0)
        return np.asarray(self.level * (self.ambient + (1 - self.ambient) * direct / len(points)))
