"""Two mirrors for each view: a coated wedge or an inner pair on the axis, and an outer pair, all first-surface mirrors.

`wedge`: Duvieubourg and others 2004, Lu and others 2006: a coated prism with its edge to the lens, far in front of it.
`four_mirrors`: adapters of the Tri-Delta kind. Both are exact pinholes, not crossed and not mirrored: the right half of the
frame is the right view.
"""

from __future__ import annotations

import math
from dataclasses import replace

from prismstereo_hw.optics.surfaces import Surface, strip
from prismstereo_hw.rig import Rig, require
from prismstereo_hw.view import LAYOUTS, Side, View

__all__ = ["FourMirrorRig", "WedgeRig"]


class _MirrorPairs(Rig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The geometry both kinds share: an edge on the axis, inner faces that rise from it, outer mirrors beside them."""

    pupil_to_edge_mm: float
    outer_angle_deg: float  # of the outer mirrors from the x axis
    near_edge_mm: float  # distance of an outer mirror's near edge from the axis
    offset_mm: float  # of that edge above the inner edge
    outer_length_mm: float
    height_mm: float  # of everything, along y

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        for label, value, most in (
            ("pupil_to_edge_mm", self.pupil_to_edge_mm, 5000),
            ("near_edge_mm", self.near_edge_mm, 2000),
            ("outer_length_mm", self.outer_length_mm, 2000),
            ("height_mm", self.height_mm, 2000),
        ):
            require(0 < value <= most, f"{label} is {value:g}: give something above 0 and up to {most} mm")
        require(abs(self.offset_mm) <= 2000, f"offset_mm is {self.offset_mm:g}: give -2000 to 2000 mm")
        require(
            20 < self.outer_angle_deg < 80,
            f"outer_angle_deg is {self.outer_angle_deg:g}: the views look forward only between 20 and 80 degrees",
        )

    @property
    def views(self) -> tuple[View, View]:
        """The left half is the left view."""
        return LAYOUTS["side-by-side"]

    @property
    def split_edge_mm(self) -> float:
        """The edge between the inner faces."""
        return self.pupil_to_edge_mm

    def obstacles(self, side: Side) -> tuple[Surface, ...]:
        """Return the inner faces and the other outer mirror."""
        (own, _), (other, mirror) = self.surfaces(side), self.surfaces("right" if side == "left" else "left")
        inner = tuple(replace(face, name="runs into the inner faces") for face in (own, other))
        return (*inner, replace(mirror, name="strikes the other mirror"))

    def _surfaces(self, side: Side, inner_deg: float, inner_length_mm: float, inner_name: str) -> tuple[Surface, ...]:
        s, edge = (-1.0 if side == "left" else 1.0), self.pupil_to_edge_mm
        inner, outer = math.radians(inner_deg), math.radians(self.outer_angle_deg)
        top = (s * inner_length_mm * math.cos(inner), edge + inner_length_mm * math.sin(inner))
        near = (s * self.near_edge_mm, edge + self.offset_mm)
        far = (near[0] + s * self.outer_length_mm * math.cos(outer), near[1] + self.outer_length_mm * math.sin(outer))
        return (
            strip(f"{side} {inner_name}", "reflect", (0.0, edge), top, self.height_mm),
            strip(f"{side} mirror", "reflect", near, far, self.height_mm),
        )


class WedgeRig(_MirrorPairs, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="wedge"):
    """A coated wedge, its edge to the lens."""

    wedge_angle_deg: float  # full angle at the edge
    wedge_face_mm: float

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        require(
            20 <= self.wedge_angle_deg <= 120, f"wedge_angle_deg is {self.wedge_angle_deg:g}: give 20 to 120 degrees"
        )
        require(1 <= self.wedge_face_mm <= 2000, f"wedge_face_mm is {self.wedge_face_mm:g}: give 1 to 2000 mm")

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return the coated face and the outer mirror of one side."""
        return self._surfaces(side, 90 - self.wedge_angle_deg / 2, self.wedge_face_mm, "face")


class FourMirrorRig(_MirrorPairs, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="four_mirrors"):
    """An inner pair of mirrors that meet on the axis, and an outer pair."""

    inner_angle_deg: float  # of the inner mirrors from the x axis
    inner_length_mm: float

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        require(20 <= self.inner_angle_deg <= 80, f"inner_angle_deg is {self.inner_angle_deg:g}: give 20 to 80 degrees")
        require(1 <= self.inner_length_mm <= 2000, f"inner_length_mm is {self.inner_length_mm:g}: give 1 to 2000 mm")

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return the inner and the outer mirror of one side."""
        return self._surfaces(side, self.inner_angle_deg, self.inner_length_mm, "inner mirror")
