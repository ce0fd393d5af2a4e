"""Three planar mirrors whose planes share one line: views rectified by construction (Gluckman and Nayar 2000, 2002).

The left half of the frame sees one mirror, the right half two, one after the other. With an odd number of reflections in
all and every mirror plane through one line, the pinholes stand at equal distance from the scene and both fields are the
same; the scene lies to the left of the camera.
"""

from __future__ import annotations

import math

import msgspec

from prismstereo_hw.optics.surfaces import Surface, strip
from prismstereo_hw.rig import Rig, require
from prismstereo_hw.view import Side, View

__all__ = ["MirrorStrip", "ThreeMirrorRig"]

_VIEWS = (
    View(left=0.5, top=0.0, width=0.5, height=1.0),
    View(left=0.0, top=0.0, width=0.5, height=1.0, mirrored=True),
)


class MirrorStrip(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One mirror: its direction from the x axis, and where it begins and ends, measured from the common line."""

    angle_deg: float
    begin_mm: float
    end_mm: float


class ThreeMirrorRig(Rig, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="three_mirrors"):
    """`single` serves the left half of the frame; `inner`, then `outer`, serve the right half."""

    line_x_mm: float  # of the line in which all mirror planes meet
    line_z_mm: float
    single: MirrorStrip
    inner: MirrorStrip
    outer: MirrorStrip
    mirror_height_mm: float

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        require(
            all(math.isfinite(value) for value in (self.line_x_mm, self.line_z_mm)) and self.line_z_mm > 0,
            f"the common line at x {self.line_x_mm:g}, z {self.line_z_mm:g}: it stands in front of the lens",
        )
        for label, mirror in (("single", self.single), ("inner", self.inner), ("outer", self.outer)):
            require(
                0 < mirror.angle_deg < 180 and 0.1 <= abs(mirror.end_mm - mirror.begin_mm) <= 2000,
                f"mirror {label} at {mirror.angle_deg:g} degrees from {mirror.begin_mm:g} to {mirror.end_mm:g} mm: give an "
                "angle between 0 and 180 and a length up to 2000",
            )
        require(1 <= self.mirror_height_mm <= 2000, f"mirror_height_mm is {self.mirror_height_mm:g}: give 1 to 2000 mm")

    @property
    def views(self) -> tuple[View, View]:
        """The right half, seen by two mirrors, is the left view; the left half, seen by one, is mirrored."""
        return _VIEWS

    @property
    def split_edge_mm(self) -> float:
        """The nearer end of the inner mirror, on the axis."""
        return self._ends(self.inner)[0][1]

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return the two mirrors of the left view, or the one of the right view."""
        own = (
            {"inner mirror": self.inner, "outer mirror": self.outer}
            if side == "left"
            else {"single mirror": self.single}
        )
        return tuple(strip(name, "reflect", *self._ends(mirror), self.mirror_height_mm) for name, mirror in own.items())

    def _ends(self, mirror: MirrorStrip) -> tuple[tuple[float, float], tuple[float, float]]:
        c, s = math.cos(math.radians(mirror.angle_deg)), math.sin(math.radians(mirror.angle_deg))
        begin, end = ((self.line_x_mm + c * t, self.line_z_mm + s * t) for t in (mirror.begin_mm, mirror.end_mm))
        return begin, end
