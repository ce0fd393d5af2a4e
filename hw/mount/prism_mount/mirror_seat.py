"""A mirror's seat: a back plate on the body and a carrier in front of it, held by one pivot and two adjusting screws.

The three M3 screws come from behind, through the back plate, into captive nuts in the carrier; springs push the carrier
forward. Pivot and tip screw lie on a line parallel to the prism's edges: turning the vergence screw swings the mirror
about it. Pivot and vergence screw lie along the mirror: turning the tip screw throws the view up or down.
"""

from __future__ import annotations

from build123d import Part

from prism_mount.hole import Hole, drilled
from prism_mount.layout import DEPTHS, Layout, SeatFrame
from prism_mount.solids import block, hexagon_pocket, prism_along, rod
from prism_mount.stock import STOCK

__all__ = ["back_plate", "carrier", "mirror"]

_NUT_SEAT_MM = 7.5  # depth of the captive nut's bearing face


def mirror(layout: Layout, seat: SeatFrame) -> Part:
    """Return the mirror itself, for drawings and checks."""
    half = layout.rig.mirrors.height_mm / 2
    return block(seat, (0.0, layout.rig.mirrors.length_mm), (-half, half), (0.0, DEPTHS.glass))


def _name(seat: SeatFrame) -> str:
    return "right" if seat.side > 0 else "left"


def back_plate(layout: Layout, seat: SeatFrame) -> tuple[Part, list[Hole]]:
    """Return the upright behind one mirror with its gusset and pivot, not yet drilled, and its holes."""
    length, half = layout.rig.mirrors.length_mm, layout.rig.mirrors.height_mm / 2
    foot = layout.floor_mm + 1.0
    plate = block(seat, (-0.5, length + 0.5), (-half - 1.5, foot), (DEPTHS.plate_front, DEPTHS.plate_back))
    middle = length / 2
    gusset = prism_along(
        [
            seat.point(middle - 2, v, w)
            for v, w in ((foot, DEPTHS.plate_back - 1), (foot, DEPTHS.foot), (-20.0, DEPTHS.plate_back - 1))
        ],
        4.0 * seat.u,
    )
    u, v = layout.adjusters["pivot"]
    pivot = rod(seat.point(u, v, DEPTHS.plate_front), seat.point(u, v, DEPTHS.carrier_back + STOCK.touch_mm), 9.0, 5.4)
    part = plate + gusset + pivot
    for name in ("tip", "vergence"):
        u, v = layout.adjusters[name]
        pocket = (
            seat.point(u, v, DEPTHS.plate_front - 0.5),
            seat.point(u, v, DEPTHS.plate_front + STOCK.spring_pocket_mm),
        )
        part = part - rod(*pocket, STOCK.spring_diameter_mm + 0.8)
    holes = []
    for name, (u, v) in layout.adjusters.items():
        front = DEPTHS.carrier_back if name == "pivot" else DEPTHS.plate_front + STOCK.spring_pocket_mm
        ends = seat.point(u, v, front), seat.point(u, v, DEPTHS.plate_back)
        holes.append(Hole("body", f"{_name(seat)} mirror, {name} screw M3x16", *ends, STOCK.clearance_hole_mm))
    return part, holes


def carrier(layout: Layout, seat: SeatFrame) -> tuple[Part, list[Hole]]:
    """Return the plate that carries one mirror on three pads, a ledge and a stop; nothing stands before the mirror."""
    length, half = layout.rig.mirrors.length_mm, layout.rig.mirrors.height_mm / 2
    front, back = DEPTHS.carrier_front, DEPTHS.carrier_back
    part = block(seat, (2.0, length + 2.3), (-half, half + 2.1), (front, back))
    part = part + block(seat, (8.0, length - 6.0), (half + 0.2, half + 2.1), (0.7, front + 0.5))
    part = part + block(seat, (length + 0.2, length + 2.3), (-0.6 * half, 0.6 * half), (0.7, front + 0.5))
    for u, v in ((0.35 * length, -0.6 * half), (0.35 * length, 0.6 * half), (0.8 * length, 0.0)):
        pad = seat.point(u, v, front + 0.5), seat.point(u, v, DEPTHS.glass)
        part = part + rod(*pad, STOCK.pad_diameter_mm)
    holes = []
    for name, (u, v) in layout.adjusters.items():
        pocket = seat.point(u, v, front - 1.0), seat.point(u, v, _NUT_SEAT_MM)
        part = part - hexagon_pocket(*pocket, STOCK.nut_across_flats_mm, seat.v)
        ends = seat.point(u, v, _NUT_SEAT_MM), seat.point(u, v, back)
        holes.append(
            Hole(f"carrier-{_name(seat)}", f"{name} screw M3x16, nut in front", *ends, STOCK.clearance_hole_mm)
        )
    return drilled(part, holes, over_mm=0.5), holes
