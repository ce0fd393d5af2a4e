"""What is bought and what the printer can do: sizes that belong to no rig. Lengths in millimetres."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["STOCK", "Stock"]


@dataclass(frozen=True, slots=True)
class Stock:
    """Screws, springs, glass and printing allowances."""

    mirror_thickness_mm: float = 3.0  # first-surface mirrors of this size are sold as 3 mm or 1/8 inch; pads take both
    pad_height_mm: float = 0.5  # room for the silicone between mirror and carrier
    pad_diameter_mm: float = 8.0
    glass_clearance_mm: float = 0.15  # printed pockets come out tight
    clearance_hole_mm: float = 3.4  # M3
    insert_hole_mm: float = 4.0  # M3 heat-set insert, 5 to 6 long
    insert_depth_mm: float = 6.0
    nut_across_flats_mm: float = 5.6  # M3 nut 5.5
    spring_diameter_mm: float = 6.0  # compression spring over M3: outer 5 to 6, wire 0.6, free length 10
    spring_pocket_mm: float = 1.5
    adjuster_travel_mm: float = 1.2  # either way; more, and the nut leaves the screw
    screw_pitch_mm: float = 0.5
    tripod_hole_mm: float = 6.6  # 1/4-20 UNC
    tripod_nut_across_flats_mm: float = 11.4  # 7/16 inch is 11.11
    tripod_nut_depth_mm: float = 5.8
    plate_mm: float = 6.0
    wall_mm: float = 3.0
    touch_mm: float = 0.02  # parts that touch are drawn this far apart, so that their meshes share no edge
    ray_clearance_mm: float = 1.2  # between the outermost ray and printed material


STOCK = Stock()
