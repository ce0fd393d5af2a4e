"""A ring that screws into a lens' filter thread, or into a C-mount, and carries the body by four countersunk screws.

The thread is a real helix: a V of 60 degrees on a core, made a little small, as printed threads grow.
"""

from __future__ import annotations

import math

import numpy as np
from build123d import Face, Helix, Part, Solid, Wire

from prism_mount.hole import Hole, drilled
from prism_mount.interface import Interface
from prism_mount.layout import Layout
from prism_mount.solids import cuboid, rod
from prism_mount.stock import STOCK
from prismstereo_hw.errors import RigError

__all__ = ["lens_ring"]

_FLANGE_MM, _STUB_MM, _STUB_WALL_MM = 3.0, 4.0, 2.4
_PLAY_MM = 0.15
_COUNTERSINK_MM = 6.8


def _core_mm(interface: Interface) -> float:
    """Return the core radius of the external thread: the V's depth is 0.6134 pitches."""
    return interface.thread_major_mm / 2 - 0.6134 * interface.thread_pitch_mm - _PLAY_MM


def _ridge(interface: Interface, z_mm: float) -> Part:
    """Sweep the thread's V along its helix, from z to the stub's free end."""
    pitch, core = interface.thread_pitch_mm, _core_mm(interface)
    height = interface.thread_major_mm / 2 - _PLAY_MM - core
    turns = math.floor((_STUB_MM - 1.2 * pitch) / pitch)
    helix = Helix(pitch, turns * pitch, core, center=(0, 0, z_mm - _STUB_MM + 0.6 * pitch), direction=(0, 0, 1))
    start, inner = helix @ 0, core - 0.1
    profile = Wire.make_polygon(
        [
            (inner, 0.0, start.Z - 0.46 * pitch),
            (core + height, 0.0, start.Z - pitch / 16),
            (core + height, 0.0, start.Z + pitch / 16),
            (inner, 0.0, start.Z + 0.46 * pitch),
        ]
    )
    return Part() + Solid.sweep(Face(profile), Wire([helix.edge()]), is_frenet=True)


def lens_ring(layout: Layout, interface: Interface, bore_mm: float, *, threaded: bool) -> tuple[Part, list[Hole]]:
    """Return a ring against the wall's rear with a bore of this radius, and its holes.

    Without its thread it stands for itself in the assembly. `RigError` when the light needs more than the thread leaves.
    """
    rear, core = layout.wall_rear_mm - _FLANGE_MM, _core_mm(interface)
    if bore_mm > core - 1.5:
        raise RigError(
            f"the light is {2 * bore_mm:.1f} mm wide at the thread {interface.name}, which leaves {2 * core - 3:.1f}: "
            "take a larger thread"
        )
    inner = max(bore_mm, core - _STUB_WALL_MM)
    flange = cuboid((-31.0, 31.0), (-25.0, 25.0), (rear, layout.wall_rear_mm))
    flange = flange + rod((0, 0, rear), (0, 0, layout.wall_rear_mm), interface.thread_major_mm + 4.0)
    stub = rod((0, 0, rear - _STUB_MM), (0, 0, rear + 0.5), 2 * core)
    part = flange + stub
    if threaded:
        part = part + _ridge(interface, rear)
    part = part - rod((0, 0, rear - _STUB_MM - 1), (0, 0, rear), 2 * inner)
    part = part - rod((0, 0, rear - 1), (0, 0, layout.wall_rear_mm + 1), 2 * bore_mm)
    holes = [
        Hole(
            "bracket",
            "M3x8 countersunk",
            np.array([x, y, rear + (_COUNTERSINK_MM - STOCK.clearance_hole_mm) / 2]),
            np.array([x, y, layout.wall_rear_mm]),
            STOCK.clearance_hole_mm,
        )
        for x, y in layout.bracket_holes
    ]
    part = drilled(part, holes, over_mm=1.0)
    for x, y in layout.bracket_holes:
        sink = (x, y, rear), (x, y, rear + _COUNTERSINK_MM / 2)
        part = part - rod(*sink, _COUNTERSINK_MM, 0.02)
    return part, holes
