"""Where things are put before a rig: in its scene frame, in sizes that its two views can show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from prismstereo_hw.optics.figures import common_strip_mm, common_width_mm
from prismstereo_hw.optics.outlook import Outlook, outlook
from prismstereo_hw.rig import Rig
from prismstereo_hw.shapes.pose import Pose, Vector
from prismstereo_hw.shapes.rectangle import Ground, Rectangle
from prismstereo_hw.shapes.shape import Array
from prismstereo_hw.texture import Noise

__all__ = ["Stage"]


@dataclass(frozen=True, slots=True)
class Stage:
    """A rig and where it looks. Everything asked of it is in the scene frame (see `optics.outlook`), mm: y is down."""

    rig: Rig
    looking: Outlook

    @classmethod
    def before(cls, rig: Rig) -> Stage:
        """Return the stage before a rig."""
        return cls(rig, outlook(rig))

    def texel_mm(self, distance_mm: float) -> float:
        """Return half a video pixel at a distance: the finest detail a sensor could see."""
        return distance_mm / self.rig.lens().fx_px / 2

    def noise(self, seed: int, distance_mm: float, mean: float = 120.0, contrast: float = 42.0) -> Noise:
        """Return a texture with detail down to what is seen at a distance."""
        return Noise(seed=seed, texel_mm=self.texel_mm(distance_mm), mean=mean, contrast=contrast)

    def middle_mm(self, distance_mm: float) -> float:
        """Return the x of the middle of what both views see at a distance."""
        return sum(common_strip_mm(self.rig, distance_mm)) / 2

    def half_width_mm(self, distance_mm: float) -> float:
        """Return half the width that both views see at a distance; a tenth of the real lens' field where that is less."""
        whole = distance_mm * math.tan(math.radians(self.rig.camera.hfov_deg / 2))
        return max(common_width_mm(self.rig, distance_mm) / 2, 0.1 * whole)

    def half_height_mm(self, distance_mm: float) -> float:
        """Return half the height that the real lens sees at a distance."""
        return distance_mm * self.rig.camera.video.height / 2 / self.rig.lens().fy_px

    def front_mm(self) -> float:
        """Return how far the rig itself reaches towards the scene: its lens, or the farthest corner of its optics."""
        corners = [self.looking.to_scene(np.zeros(3))] + [
            self.looking.to_scene(part.centre_mm + s * part.half_along_mm * part.along)
            for side in ("left", "right")
            for part in self.rig.surfaces(side)
            for s in (-1, 1)
        ]
        return max(1.0, *(float(corner[2]) for corner in corners))

    def vector(self, scene: Vector) -> Vector:
        """Take a velocity, spin or direction of the scene frame to the rig frame."""
        x, y, z = self.looking.R_rig_from_scene @ np.array(scene)
        return float(x), float(y), float(z)

    def pose(self, centre: Vector, R: Array | None = None) -> Pose:
        """Return the pose of a body whose centre and attitude (3, 3) are given in the scene frame."""
        turned = self.looking.R_rig_from_scene
        return Pose(self.looking.to_rig(np.array(centre)), turned if R is None else turned @ R)

    def facing(
        self, name: str, centre: Vector, half: tuple[float, float], seed: int, velocity: Vector = (0.0, 0.0, 0.0),
        mean: float = 120.0,
    ) -> Rectangle:  # fmt: skip
        """Return a rectangle that faces the rig."""
        R = self.looking.R_rig_from_scene
        return Rectangle(
            name=name,
            centre_mm=self.looking.to_rig(np.array(centre)),
            u=R[:, 0],
            v=R[:, 1],
            half_u_mm=half[0],
            half_v_mm=half[1],
            texture=self.noise(seed, centre[2], mean),
            velocity_mm_s=self.vector(velocity),
        )

    def ground(self, name: str, below_mm: float, fine_mm: float, seed: int, mean: float = 120.0) -> Ground:
        """Return an endless level plane below the rig, with detail as fine as is seen `fine_mm` away."""
        R = self.looking.R_rig_from_scene
        plane = Rectangle(
            name=name,
            centre_mm=self.looking.to_rig(np.array([0.0, below_mm, 0.0])),
            u=R[:, 0],
            v=R[:, 2],
            half_u_mm=np.inf,
            half_v_mm=np.inf,
            texture=self.noise(seed, fine_mm, mean),
        )
        return Ground(plane, self.looking.to_rig(np.zeros(3)))
