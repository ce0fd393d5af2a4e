"""Brackets that carry a camera behind the wall: side rails for a housing, bosses for a board."""

from __future__ import annotations

import numpy as np
from build123d import Part

from prism_mount.hole import Hole, drilled
from prism_mount.interface import Interface
from prism_mount.layout import Layout
from prism_mount.lens_ring import lens_ring
from prism_mount.solids import cuboid, rod
from prism_mount.stock import STOCK

__all__ = ["bracket"]

_TAB_MM, _RAIL_MM, _LIP_MM = 4.0, 3.4, 3.0
_SLIDE_MM = 1.5  # the camera can be moved sideways by this much, to bring the seam to the middle
_CLEARANCE_MM = 0.2
_SELF_TAP_MM = 1.7  # M2 screw into plastic


def bracket(layout: Layout) -> tuple[Part, list[Hole]]:
    """Return the bracket of the layout's camera and its holes."""
    interface = layout.interface
    if interface.kind == "housing":
        return _rails(layout, interface)
    if interface.kind == "board":
        return _board_plate(layout, interface)
    rear = layout.wall_rear_mm
    return lens_ring(layout, interface, layout.bore_mm(rear, rear - 7.0), threaded=False)


def _slotted(layout: Layout, part: Part, thickness_mm: float) -> Part:
    """Cut the four slots by which a bracket is screwed to the wall, and moved sideways."""
    rear, radius = layout.wall_rear_mm, STOCK.clearance_hole_mm / 2
    for x, y in layout.bracket_holes:
        part = part - cuboid(
            (x - _SLIDE_MM, x + _SLIDE_MM), (y - radius, y + radius), (rear - thickness_mm - 1, rear + 1)
        )
        for end in (x - _SLIDE_MM, x + _SLIDE_MM):
            part = part - rod((end, y, rear - thickness_mm - 1), (end, y, rear + 1), 2 * radius)
    return part


def _rails(layout: Layout, interface: Interface) -> tuple[Part, list[Hole]]:
    width, _, depth = interface.housing_mm
    rear, face = layout.wall_rear_mm, min(interface.face_mm, layout.wall_rear_mm)
    inside, behind = width / 2 + _CLEARANCE_MM, face - depth - 1.0  # a millimetre for foam
    part, holes = cuboid((-inside, inside), (20.0, 25.0), (behind - _LIP_MM, behind)), []
    for side in (-1.0, 1.0):

        def across(a: float, b: float, side: float = side) -> tuple[float, float]:
            return (a, b) if side > 0 else (-b, -a)

        rail = cuboid(across(inside, inside + _RAIL_MM), (-25.0, 25.0), (behind - _LIP_MM, rear))
        tab = cuboid(across(inside, 31.0), (-25.0, 25.0), (rear - _TAB_MM, rear))
        lip = cuboid(across(inside - 3.0, inside + _RAIL_MM), (-25.0, 25.0), (behind - _LIP_MM, behind))
        part = part + rail + tab + lip
        middle = face - depth / 2
        ends = np.array([side * inside, 0.0, middle]), np.array([side * (inside + _RAIL_MM), 0.0, middle])
        holes.append(Hole("bracket", "M3 insert, clamping screw with foam", *ends, STOCK.insert_hole_mm))
    return _slotted(layout, drilled(part, holes, over_mm=0.5), _TAB_MM), holes


def _board_plate(layout: Layout, interface: Interface) -> tuple[Part, list[Hole]]:
    rear, thickness = layout.wall_rear_mm, 3.0
    window = interface.lens_box_mm / 2 + 0.5
    board = min(interface.face_mm, rear) - interface.lens_above_board_mm
    part = cuboid((-31.0, 31.0), (-25.0, 25.0), (rear - thickness, rear))
    part = part - cuboid((-window, window), (-window, window), (rear - thickness - 1, rear + 1))
    half, up = interface.hole_span_mm[0] / 2, interface.hole_span_mm[1]
    holes = []
    for x in (-half, half):
        for y in (0.0, -up):
            part = part + rod((x, y, board), (x, y, rear - thickness + 0.5), 5.0)
            ends = np.array([x, y, board]), np.array([x, y, rear - 0.6])
            holes.append(Hole("bracket", "M2x6 screw through the board", *ends, _SELF_TAP_MM))
    return _slotted(layout, drilled(part, holes), thickness), holes
