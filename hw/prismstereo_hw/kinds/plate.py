"""A glass plate that is turned between two exposures (Gao and Ahuja 2004): one view at a time, of a scene at rest.

The plate shifts every ray sideways and bends none, so the view stays as it is and its pinhole moves: to the left in the
first exposure, to the right in the second. Not quite a pinhole: the shift depends on the angle of the ray.
"""

from __future__ import annotations

import math

import numpy as np

from prismstereo_hw.glass import refractive_index
from prismstereo_hw.optics.surfaces import Surface
from prismstereo_hw.rig import Rig, require
from prismstereo_hw.view import Side, View

__all__ = ["PlateRig"]

_VIEWS = (
    View(left=0.0, top=0.0, width=1.0, height=1.0, exposure=0, exposures=2),
    View(left=0.0, top=0.0, width=1.0, height=1.0, exposure=1, exposures=2),
)


class PlateRig(Rig, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="plate"):
    """The plate turns about a line parallel to y through its middle."""

    pupil_to_plate_mm: float  # to the plate's middle
    thickness_mm: float
    tilt_deg: float  # each way
    side_mm: float  # the plate is square
    glass: str

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        require(1 <= self.thickness_mm <= 200, f"thickness_mm is {self.thickness_mm:g}: give 1 to 200 mm")
        require(1 <= self.tilt_deg <= 60, f"tilt_deg is {self.tilt_deg:g}: give 1 to 60 degrees")
        require(5 <= self.side_mm <= 1000, f"side_mm is {self.side_mm:g}: give 5 to 1000 mm")
        tilt = math.radians(self.tilt_deg)
        room = (self.side_mm * math.sin(tilt) + self.thickness_mm * math.cos(tilt)) / 2
        require(
            room < self.pupil_to_plate_mm <= 2000,
            f"pupil_to_plate_mm is {self.pupil_to_plate_mm:g}, but the turned plate reaches {room:.0f} mm back from its "
            "middle: move it away from the lens",
        )
        require(refractive_index(self.glass) > 1, f"glass {self.glass!r} shifts nothing")

    @property
    def views(self) -> tuple[View, View]:
        """The whole frame of the first exposure is the left view, that of the second the right one."""
        return _VIEWS

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return the plate's two faces in one of its positions."""
        tilt = math.radians(self.tilt_deg if side == "right" else -self.tilt_deg)
        normal = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
        along, y = np.array([math.cos(tilt), 0.0, -math.sin(tilt)]), np.array([0.0, 1.0, 0.0])
        middle, n = np.array([0.0, 0.0, self.pupil_to_plate_mm]), refractive_index(self.glass)
        faces = ((-1.0, "near face", 1.0, n), (1.0, "far face", n, 1.0))
        half = self.side_mm / 2
        return tuple(
            Surface(name, "refract", middle + s * self.thickness_mm / 2 * normal, along, y, half, half, before, after)
            for s, name, before, after in faces
        )
