"""A field-sequential adapter of the NuView kind: two views in alternate rows of one interlaced frame.

Shutters before the lens let one view pass while the even rows are exposed, the other while the odd ones are. Two half
mirrors cross on the axis and send each view to an outer mirror on its side, so both views have all columns and half the
rows. Exact pinholes, not crossed and not mirrored.
"""

from __future__ import annotations

import math

from prismstereo_hw.optics.surfaces import Surface, strip
from prismstereo_hw.rig import Rig, require
from prismstereo_hw.view import Side, View

__all__ = ["FieldSequentialRig"]

_VIEWS = (
    View(left=0.0, top=0.0, width=1.0, height=1.0, row_start=0, row_step=2),
    View(left=0.0, top=0.0, width=1.0, height=1.0, row_start=1, row_step=2),
)


class FieldSequentialRig(Rig, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="field_sequential"):
    """The half mirrors stand at 45 degrees; the outer ones are turned from that by a quarter of the vergence."""

    pupil_to_crossing_mm: float  # along the axis
    outer_distance_mm: float  # of the outer mirrors' middles from the axis: half the baseline
    vergence_deg: float
    half_mirror_length_mm: float
    outer_length_mm: float
    height_mm: float

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        for label, value in (
            ("pupil_to_crossing_mm", self.pupil_to_crossing_mm),
            ("outer_distance_mm", self.outer_distance_mm),
            ("half_mirror_length_mm", self.half_mirror_length_mm),
            ("outer_length_mm", self.outer_length_mm),
            ("height_mm", self.height_mm),
        ):
            require(1 <= value <= 2000, f"{label} is {value:g}: give millimetres between 1 and 2000")
        require(0 <= self.vergence_deg <= 20, f"vergence_deg is {self.vergence_deg:g}: give 0 to 20 degrees")

    @property
    def views(self) -> tuple[View, View]:
        """The even rows are the left view, the odd rows the right one."""
        return _VIEWS

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return the half mirror and the outer mirror of one view."""
        s, axis = (-1.0 if side == "left" else 1.0), self.pupil_to_crossing_mm

        def mirror(name: str, x: float, angle_deg: float, length: float) -> Surface:
            dx, dz = (length / 2 * f(math.radians(angle_deg)) for f in (math.cos, math.sin))
            return strip(name, "reflect", (s * (x - dx), axis - dz), (s * (x + dx), axis + dz), self.height_mm)

        return (
            mirror(f"{side} half mirror", 0.0, 45.0, self.half_mirror_length_mm),
            mirror(f"{side} mirror", self.outer_distance_mm, 45.0 + self.vergence_deg / 4, self.outer_length_mm),
        )
