"""A biprism in front of the lens (Lee, Kweon and Cipolla 1999): each half of it bends the view towards the middle.

The flat side faces the lens, the ridge the scene. The glass bends directions and disperses colours, so no view is a
pinhole and each needs a distortion of its own; its rays have no closed form here and are traced.
"""

from __future__ import annotations

import math

from prismstereo_hw.glass import refractive_index
from prismstereo_hw.optics.surfaces import Surface, strip
from prismstereo_hw.rig import Rig, require
from prismstereo_hw.view import LAYOUTS, Side, View

__all__ = ["BiprismRig"]


class BiprismRig(Rig, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="biprism"):
    """The ridge stands on the axis; the glass is as thin as its rim allows."""

    pupil_to_base_mm: float
    base_angle_deg: float
    half_width_mm: float
    rim_mm: float  # thickness at the outer edges
    height_mm: float  # along y
    glass: str

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        require(1 <= self.pupil_to_base_mm <= 2000, f"pupil_to_base_mm is {self.pupil_to_base_mm:g}: give 1 to 2000 mm")
        require(0.1 <= self.base_angle_deg <= 35, f"base_angle_deg is {self.base_angle_deg:g}: give 0.1 to 35 degrees")
        require(1 <= self.half_width_mm <= 1000, f"half_width_mm is {self.half_width_mm:g}: give 1 to 1000 mm")
        require(0 <= self.rim_mm <= 100, f"rim_mm is {self.rim_mm:g}: give 0 to 100 mm")
        require(1 <= self.height_mm <= 2000, f"height_mm is {self.height_mm:g}: give 1 to 2000 mm")
        require(refractive_index(self.glass) > 1, f"glass {self.glass!r} bends nothing")

    @property
    def views(self) -> tuple[View, View]:
        """Each half of the frame looks through its own half of the glass, and sees from its own side."""
        return LAYOUTS["side-by-side"]

    @property
    def own_lens_per_view(self) -> bool:
        """A wedge of glass stretches its view unevenly."""
        return True

    @property
    def split_edge_mm(self) -> float:
        """The ridge, reduced by the glass before it."""
        return self.pupil_to_base_mm + self._thickness_mm / refractive_index(self.glass)

    @property
    def _thickness_mm(self) -> float:
        return self.rim_mm + self.half_width_mm * math.tan(math.radians(self.base_angle_deg))

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return the flat base and the facet of one side."""
        s, n = (-1.0 if side == "left" else 1.0), refractive_index(self.glass)
        base, width = self.pupil_to_base_mm, self.half_width_mm
        ridge, rim = (0.0, base + self._thickness_mm), (s * width, base + self.rim_mm)
        return (
            strip("flat side", "refract", (-width, base), (width, base), self.height_mm, 1.0, n),
            strip(f"{side} facet", "refract", ridge, rim, self.height_mm, n, 1.0),
        )
