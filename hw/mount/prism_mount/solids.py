"""Few ways to make a solid in the rig frame: a slab of constant section along y, a block in a seat's axes, a rod.

The only module, with its neighbours that cut material, that needs the CAD kernel (build123d, extra `cad`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from build123d import Face, Part, Plane, Solid, Vector, Wire
from numpy.typing import NDArray

from prism_mount.layout import SeatFrame

__all__ = ["block", "cuboid", "hexagon_pocket", "prism_along", "rod", "slab", "union"]

Array = NDArray[np.float64]


def prism_along(corners: Iterable[Sequence[float] | Array], sweep: Sequence[float] | Array) -> Part:
    """Extrude a plane polygon with corners (x, y, z) along a vector."""
    face = Face(Wire.make_polygon([Vector(*map(float, corner)) for corner in corners], close=True))
    return Part() + Solid.extrude(face, Vector(*map(float, sweep)))


def slab(outline_xz: Iterable[Sequence[float] | Array], y_from: float, y_to: float) -> Part:
    """Extrude an outline in the xz plane from one y to another."""
    return prism_along([(x, y_from, z) for x, z in outline_xz], (0.0, y_to - y_from, 0.0))


def cuboid(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Part:
    """Make an upright box from its ranges."""
    return slab([(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])], *y)


def block(seat: SeatFrame, u: tuple[float, float], v: tuple[float, float], w: tuple[float, float]) -> Part:
    """Make a box in a mirror seat's axes from its ranges."""
    corners = [seat.point(a, v[0], b) for a, b in ((u[0], w[0]), (u[1], w[0]), (u[1], w[1]), (u[0], w[1]))]
    return prism_along(corners, (v[1] - v[0]) * seat.v)


def rod(
    start: Sequence[float] | Array, end: Sequence[float] | Array, diameter: float, end_diameter: float = 0.0
) -> Part:
    """Make a cylinder between two points, or a cone when the end has another diameter."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    plane = Plane(origin=tuple(a), z_dir=tuple((b - a) / length))
    if end_diameter:
        return Part() + Solid.make_cone(diameter / 2, end_diameter / 2, length, plane)
    return Part() + Solid.make_cylinder(diameter / 2, length, plane)


def hexagon_pocket(start: Array, end: Array, across_flats: float, up: Array) -> Part:
    """Make the hexagonal hole of a captive nut between two points; one corner points along `up`."""
    axis = (end - start) / np.linalg.norm(end - start)
    sideways = np.cross(axis, up)
    radius = across_flats / math.sqrt(3)
    turns = np.radians(np.arange(0, 360, 60))
    return prism_along([start + radius * (math.cos(t) * up + math.sin(t) * sideways) for t in turns], end - start)


def union(parts: Iterable[Part]) -> Part:
    """Fuse parts into one."""
    first, *rest = parts
    return Part() + first.fuse(*rest) if rest else first
