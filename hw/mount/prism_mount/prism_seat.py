"""The prism's seat and clamp: six clips that hold its corners where no ray passes, a floor, and a lid that presses.

The base rests against two clips without play (its datum); flanks and apex have the printing clearance. Light uses the
middle of the prism's length only, so the clips reach `_GRIP_MM` over each end.
"""

from __future__ import annotations

import math

import numpy as np
from build123d import Part

from prism_mount.hole import Hole, drilled
from prism_mount.layout import Layout
from prism_mount.solids import cuboid, hexagon_pocket, rod, slab, union
from prism_mount.stock import STOCK

__all__ = ["clamp", "clamp_holes", "prism", "seat", "tripod_hole"]

_GRIP_MM = 4.0
_RIM_MM = 3.0
_CORNER_MM = 12.0
_FOAM_GAP_MM = 1.6
_LID_MM = 5.0

Outline = list[tuple[float, float]]


def _triangle(layout: Layout, flank_mm: float, base_mm: float) -> Outline:
    """Return the prism's section, its flanks moved out by one distance and its base by another."""
    half = layout.rig.prism.side_mm / 2 + flank_mm / math.sin(math.pi / 3) + base_mm / math.tan(math.pi / 3)
    return [(-half, layout.base_mm - base_mm), (half, layout.base_mm - base_mm), (0.0, layout.apex_mm + 2 * flank_mm)]


def _clips(layout: Layout, y_from: float, y_to: float, play_mm: float) -> Part:
    half, base = layout.rig.prism.side_mm / 2, layout.base_mm
    rim = slab(_triangle(layout, _RIM_MM, _RIM_MM), y_from, y_to)
    rim = rim - slab(_triangle(layout, STOCK.glass_clearance_mm + play_mm, play_mm), y_from - 1, y_to + 1)
    corners = union(
        rod((x, y_from, z), (x, y_to, z), _CORNER_MM) for x, z in ((-half, base), (half, base), (0.0, layout.apex_mm))
    )
    return Part() + rim.intersect(corners)


def prism(layout: Layout) -> Part:
    """Return the glass itself, for drawings and checks."""
    half = layout.rig.prism.length_mm / 2
    return slab(_triangle(layout, 0.0, 0.0), -half, half)


def seat(layout: Layout) -> Part:
    """Return the floor under the prism and the lower three clips: part of the body."""
    half = layout.rig.prism.length_mm / 2
    floor = slab(_triangle(layout, _RIM_MM, _RIM_MM), half, layout.floor_mm + 1.0)
    return floor + _clips(layout, half - _GRIP_MM, half + 0.5, 0.0)


def tripod_hole(layout: Layout, body: Part) -> tuple[Part, Hole]:
    """Cut the tripod thread's hole and its captive nut under the prism; return the body and the hole."""
    middle = layout.base_mm + layout.rig.prism.height_mm / 3
    top = np.array([0.0, layout.rig.prism.length_mm / 2, middle])
    nut_end = top + np.array([0.0, STOCK.tripod_nut_depth_mm, 0.0])
    below = np.array([0.0, layout.underside_mm, middle])
    hole = Hole("body", "1/4-20 tripod screw, nut above", nut_end, below, STOCK.tripod_hole_mm)
    pocket = hexagon_pocket(
        top - np.array([0.0, 1.0, 0.0]), nut_end, STOCK.tripod_nut_across_flats_mm, np.array([1.0, 0, 0])
    )
    return drilled(body - pocket, [hole], over_mm=1.0), hole


def clamp_holes(layout: Layout) -> list[Hole]:
    """Return the two screw holes through the clamp's lid, above the columns."""
    return [
        Hole(
            "clamp",
            "M3 screw into the column",
            np.array([x, layout.top_mm - _LID_MM, z]),
            np.array([x, layout.top_mm, z]),
            STOCK.clearance_hole_mm,
        )
        for x, z in layout.columns
    ]


def clamp(layout: Layout) -> Part:
    """Return the lid: a bar on the two columns, a foot over the prism's upper end, the upper three clips."""
    half, top = layout.rig.prism.length_mm / 2, layout.top_mm
    reach = layout.columns[1][0] + 4.0
    bar = cuboid((-reach, reach), (top - _LID_MM, top - STOCK.touch_mm), (layout.base_mm - 4.0, layout.base_mm + 4.0))
    cover = slab(_triangle(layout, _RIM_MM, _RIM_MM), top - _LID_MM, -half - _FOAM_GAP_MM)
    clips = _clips(layout, -half - _FOAM_GAP_MM - 0.5, -half + _GRIP_MM, STOCK.glass_clearance_mm)
    return drilled(bar + cover + clips, clamp_holes(layout), over_mm=1.0)
