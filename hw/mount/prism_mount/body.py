"""The body, one printed piece: base plate, wall to the camera, columns, the prism's seat, two back plates, the baffle."""

from __future__ import annotations

import numpy as np
from build123d import Part

from prism_mount import prism_seat
from prism_mount.baffle import baffle
from prism_mount.hole import Hole, drilled
from prism_mount.layout import DEPTHS, Layout
from prism_mount.mirror_seat import back_plate
from prism_mount.solids import cuboid, rod, slab, union
from prism_mount.stock import STOCK

__all__ = ["body"]

_NOTCH_HALF_MM = 18.6  # the clamp's foot comes down between the columns
_FOOT_HOLE_MM = 4.4


def _wall(layout: Layout) -> Part:
    rear, top, bottom = layout.wall_rear_mm, layout.top_mm, layout.floor_mm + 1.0
    wall = cuboid((-30.0, 30.0), (top, bottom), (rear, rear + STOCK.wall_mm))
    notch_floor = -layout.rig.prism.length_mm / 2 + 4.9
    wall = wall - cuboid((-_NOTCH_HALF_MM, _NOTCH_HALF_MM), (top - 1, notch_floor), (rear - 1, rear + 9.0))
    columns = [cuboid((x - 4, x + 4), (top, bottom), (z - 4, z + 4)) for x, z in layout.columns]
    radius = layout.bore_mm(rear, rear + STOCK.wall_mm)
    return union([wall, *columns]) - rod((0, 0, rear - 1), (0, 0, rear + STOCK.wall_mm + 0.99), 2 * radius)


def _holes(layout: Layout) -> list[Hole]:
    rear, deep = layout.wall_rear_mm, STOCK.insert_depth_mm
    holes = [
        Hole("body", "M3 insert, bracket", np.array([x, y, rear]), np.array([x, y, rear + deep]), STOCK.insert_hole_mm)
        for x, y in layout.bracket_holes
    ]
    holes += [
        Hole(
            "body",
            "M3 insert, clamp",
            np.array([x, layout.top_mm, z]),
            np.array([x, layout.top_mm + deep, z]),
            STOCK.insert_hole_mm,
        )
        for x, z in layout.columns
    ]
    for side in (-1.0, 1.0):
        seat = layout.seat(side)
        for u in (12.0, layout.rig.mirrors.length_mm - 10.0):
            top, bottom = seat.point(u, layout.floor_mm, 27.0), seat.point(u, layout.underside_mm, 27.0)
            holes.append(Hole("body", "M4 screw to a bench or a frame", top, bottom, _FOOT_HOLE_MM))
    return holes


def body(layout: Layout) -> tuple[Part, list[Hole]]:
    """Return the body and its holes; what would cut a ray is taken from the base plate."""
    plate = slab(layout.outline(), layout.floor_mm, layout.underside_mm)
    for opening in layout.openings():
        plate = plate - slab(opening, layout.floor_mm - 1, layout.underside_mm + 1)
    end = layout.baffle_mm[1] + 1.5  # what is left between the openings before the baffle would be a spike
    plate = plate - cuboid((-12.0, 12.0), (layout.floor_mm - 1, layout.underside_mm + 1), (end, end + 200.0))
    uprights, screws = zip(*(back_plate(layout, layout.seat(side)) for side in (-1.0, 1.0)), strict=True)
    part = union([plate, _wall(layout), *uprights, prism_seat.seat(layout), baffle(layout)])
    part, tripod = prism_seat.tripod_hole(layout, part)
    adjusters = [hole for side in screws for hole in side]
    part = drilled(part, adjusters, over_mm=0.6)
    for seat in (layout.seat(-1.0), layout.seat(1.0)):  # room for screw heads where the back plate meets its neighbours
        for u, v in layout.adjusters.values():
            part = part - rod(seat.point(u, v, DEPTHS.plate_back), seat.point(u, v, DEPTHS.plate_back + 5.0), 7.5)
    holes = _holes(layout)
    return drilled(part, holes), [*holes, tripod, *adjusters]
