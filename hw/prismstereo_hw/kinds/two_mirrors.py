"""Two planar mirrors that meet in front of the lens (Gluckman and Nayar 1999, 2001).

The mirrors are hinged on the optical axis and turned towards the camera, so the scene lies behind it. Each half of the
frame sees one mirror; both views are mirrored. With hinge distance a and angle g the pinholes stand 2 a cos g sin g from
the axis: the baseline is 2 a sin 2 g.
"""

from __future__ import annotations

import math

from prismstereo_hw.optics.surfaces import Surface, strip
from prismstereo_hw.rig import Rig, require
from prismstereo_hw.view import Side, View

__all__ = ["TwoMirrorRig"]

_VIEWS = (
    View(left=0.5, top=0.0, width=0.5, height=1.0, mirrored=True),
    View(left=0.0, top=0.0, width=0.5, height=1.0, mirrored=True),
)


class TwoMirrorRig(Rig, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="two_mirrors"):
    """Both mirrors begin at the hinge; the viewer looks back past the camera."""

    hinge_mm: float  # from the pupil, on the axis
    turned_deg: float  # of each mirror, from square to the axis
    mirror_length_mm: float
    mirror_height_mm: float

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        require(10 <= self.hinge_mm <= 5000, f"hinge_mm is {self.hinge_mm:g}: give 10 to 5000 mm")
        require(
            0 < self.turned_deg < 30,
            f"turned_deg is {self.turned_deg:g}: at 0 both mirrors are one and show one view, past 30 degrees "
            "they cross in front of the camera; give something between",
        )
        for label, value in (("mirror_length_mm", self.mirror_length_mm), ("mirror_height_mm", self.mirror_height_mm)):
            require(1 <= value <= 2000, f"{label} is {value:g}: give millimetres between 1 and 2000")

    @property
    def views(self) -> tuple[View, View]:
        """The right half of the frame sees from the left: looking back, left and right change sides."""
        return _VIEWS

    @property
    def split_edge_mm(self) -> float:
        """The hinge."""
        return self.hinge_mm

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return the one mirror of a view."""
        s = 1.0 if side == "left" else -1.0
        turn, length = math.radians(self.turned_deg), self.mirror_length_mm
        end = (s * length * math.cos(turn), self.hinge_mm - length * math.sin(turn))
        return (strip(f"{side} mirror", "reflect", (0.0, self.hinge_mm), end, self.mirror_height_mm),)
