"""The wall between the two views' light, from the prism's apex to where the first rays cross the middle."""

from __future__ import annotations

from build123d import Part

from prism_mount.layout import Layout
from prism_mount.solids import cuboid

__all__ = ["baffle"]

_HALF_MM = 1.0


def baffle(layout: Layout) -> Part:
    """Return the wall, standing on the base plate and ending below the clamp's clips."""
    top = -layout.rig.prism.length_mm / 2 + 5.0
    return cuboid((-_HALF_MM, _HALF_MM), (top, layout.floor_mm + 1.0), layout.baffle_mm)
