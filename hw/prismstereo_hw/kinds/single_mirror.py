"""An object and its reflection (Zhang and Tsui 1998; with the mirror parallel to the axis, Gluckman and Nayar's one mirror).

The camera sees the scene directly in the left part of the frame and in one mirror, beside and parallel to the axis, in the
right part, which is mirrored. The pinholes stand twice the mirror's distance apart and the views are rectified as they are.
"""

from __future__ import annotations

import math

from prismstereo_hw.optics.surfaces import Surface, strip
from prismstereo_hw.rig import Rig, require
from prismstereo_hw.view import Side, View

__all__ = ["SingleMirrorRig"]


class SingleMirrorRig(Rig, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="single_mirror"):
    """The mirror stands at x = `mirror_x_mm` and reaches from `near_z_mm` to `far_z_mm`."""

    mirror_x_mm: float
    near_z_mm: float
    far_z_mm: float
    mirror_height_mm: float

    def __post_init__(self) -> None:
        """Refuse what no workshop can build, naming the value, the rule and the mend."""
        super().__post_init__()
        require(1 <= self.mirror_x_mm <= 5000, f"mirror_x_mm is {self.mirror_x_mm:g}: give 1 to 5000 mm")
        require(
            0 < self.near_z_mm < self.far_z_mm <= 20_000,
            f"the mirror reaches from {self.near_z_mm:g} to {self.far_z_mm:g} mm: give 0 < near < far <= 20000",
        )
        require(
            1 <= self.mirror_height_mm <= 20_000, f"mirror_height_mm is {self.mirror_height_mm:g}: give 1 to 20000 mm"
        )
        half = math.tan(math.radians(self.camera.hfov_deg / 2))
        require(
            self.mirror_x_mm / self.far_z_mm < half,
            f"the mirror ends at {self.far_z_mm:g} mm, before the field reaches it at {self.mirror_x_mm / half:.0f} mm: "
            "make it longer, or bring it nearer to the axis",
        )

    @property
    def split(self) -> float:
        """Where the mirror's far edge divides the frame, 0..1 of its width."""
        half = math.tan(math.radians(self.camera.hfov_deg / 2))
        return 0.5 + self.mirror_x_mm / self.far_z_mm / half / 2

    @property
    def views(self) -> tuple[View, View]:
        """The part that sees directly is the left view, the mirror's part the right one."""
        split = self.split
        return (
            View(left=0.0, top=0.0, width=split, height=1.0),
            View(left=split, top=0.0, width=1.0 - split, height=1.0, mirrored=True),
        )

    @property
    def split_edge_mm(self) -> float:
        """The mirror's far edge."""
        return self.far_z_mm

    def surfaces(self, side: Side) -> tuple[Surface, ...]:
        """Return the mirror for the right view, nothing for the left one."""
        if side == "left":
            return ()
        near, far = (self.mirror_x_mm, self.near_z_mm), (self.mirror_x_mm, self.far_z_mm)
        return (strip("mirror", "reflect", near, far, self.mirror_height_mm),)
