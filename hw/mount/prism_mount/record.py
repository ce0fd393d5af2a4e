"""The record of a mount, `mount.json`: what the kernel made of it, for tests and for people with callipers.

Everything geometric is read back from the finished solids, not from the numbers they were asked for: seats from their
plane faces, holes from their cylinders. Lengths in millimetres, rig frame.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from build123d import Face, GeomType, Part
from numpy.typing import NDArray

from prism_mount.assembly import Assembly
from prism_mount.hole import Hole
from prism_mount.layout import DEPTHS
from prism_mount.stock import STOCK

__all__ = ["record"]

Array = NDArray[np.float64]
_NEAR_MM, _PARALLEL = 1e-3, 1 - 1e-9


def _vector(point: Any) -> Array:
    return np.array([point.X, point.Y, point.Z])


def _planes(part: Part, normal: Array) -> list[Face]:
    """Return the plane faces of a part that look along a direction."""
    return [
        face
        for face in part.faces()
        if face.geom_type == GeomType.PLANE and float(_vector(face.normal_at()) @ normal) > _PARALLEL
    ]


def _facing(part: Part, point: Array, normal: Array, reach_mm: float) -> tuple[Array, Array]:
    """Return centre and normal of the plane faces through a point's neighbourhood that look along `normal`, averaged."""
    faces = [face for face in _planes(part, normal) if abs(float((_vector(face.center()) - point) @ normal)) < reach_mm]
    if not faces:
        raise LookupError(f"the kernel has no face near {np.round(point, 3)} that looks along {np.round(normal, 4)}")
    weights = np.array([face.area for face in faces])
    centres = np.array([_vector(face.center()) for face in faces])
    normals = np.array([_vector(face.normal_at()) for face in faces])
    return weights @ centres / weights.sum(), normals.mean(axis=0)


def _seat(origin: Array, normal: Array, clearance_mm: float, what: str) -> dict[str, Any]:
    return {
        "origin_mm": [round(float(x), 6) for x in origin],
        "normal": [round(float(x), 9) for x in normal],
        "clearance_mm": clearance_mm,
        "what": what,
    }


def _mirror_seat(assembly: Assembly, side: float) -> dict[str, Any]:
    frame, name = assembly.layout.seat(side), "right" if side > 0 else "left"
    pad = frame.point(0.0, 0.0, DEPTHS.glass)
    origin, normal = _facing(assembly.parts[f"carrier-{name}"], pad, -frame.w, 0.2)
    what = f"three pads; the reflecting surface lies the glass' {STOCK.mirror_thickness_mm} mm before them"
    return _seat(origin, normal, STOCK.mirror_thickness_mm, what)


def _seats(assembly: Assembly) -> dict[str, Any]:
    layout, body = assembly.layout, assembly.parts["body"]
    prism = layout.rig.prism
    middle = np.array([0.0, 0.0, layout.base_mm])
    origin, normal = _facing(body, middle, np.array([0.0, 0.0, 1.0]), 0.2)
    end = np.array([0.0, prism.length_mm / 2, layout.base_mm])
    floor, up = _facing(body, end, np.array([0.0, -1.0, 0.0]), 0.2)
    seats = {
        "prism base": _seat(origin, normal, 0.0, "two lower clips, the datum"),
        "prism end": _seat(floor, up, 0.0, "floor under the prism"),
    }
    for side, name in ((-1.0, "left"), (1.0, "right")):
        inward = np.array([-side * np.cos(np.pi / 6), 0.0, -np.sin(np.pi / 6)])
        flank = np.array([side * prism.side_mm / 4, 0.0, layout.base_mm + prism.height_mm / 2])
        seats[f"prism {name} face"] = _seat(
            *_facing(body, flank, inward, 0.3), STOCK.glass_clearance_mm, "lower clips, looking at the glass"
        )
        seats[f"{name} mirror"] = _mirror_seat(assembly, side)
    return seats


def _bored(assembly: Assembly, hole: Hole) -> dict[str, Any]:
    """Find a hole's cylinder in its part and describe it by what the kernel says."""
    axis = (hole.end - hole.start) / np.linalg.norm(hole.end - hole.start)
    for face in assembly.parts[hole.part].faces():
        radius, line = face.radius, face.axis_of_rotation
        if face.geom_type != GeomType.CYLINDER or radius is None or line is None:
            continue
        if abs(2 * radius - hole.diameter_mm) > _NEAR_MM:
            continue
        offset = _vector(line.position) - hole.start
        along = _vector(line.direction)
        if abs(float(along @ axis)) > _PARALLEL and np.linalg.norm(offset - axis * float(offset @ axis)) < _NEAR_MM:
            start = hole.start + (offset - axis * float(offset @ axis))
            return {
                "part": hole.part,
                "purpose": hole.purpose,
                "diameter_mm": round(2 * radius, 6),
                "start_mm": [round(float(x), 6) for x in start],
                "axis": [round(float(x), 9) for x in axis],
                "depth_mm": round(float(np.linalg.norm(hole.end - hole.start)), 6),
            }
    raise LookupError(f"the kernel has no hole for {hole.purpose!r} of {hole.diameter_mm} mm in {hole.part}")


def record(assembly: Assembly) -> dict[str, Any]:
    """Describe a finished mount as plain JSON values."""
    layout, whole = assembly.layout, assembly.compound()
    box = whole.bounding_box()
    return {
        "rig": layout.rig.name,
        "rig_sha256": hashlib.sha256(layout.rig.toml().encode()).hexdigest(),
        "frame": "rig frame: pupil at the origin, z along the optical axis, x right, y down, mm",
        "camera": {"interface": layout.interface.name, "source": layout.interface.source},
        "volume_mm3": round(sum(part.volume for part in assembly.parts.values()), 3),
        "bbox_mm": [[round(float(v), 4) for v in corner] for corner in (_vector(box.min), _vector(box.max))],
        "parts": {name: {"volume_mm3": round(part.volume, 3)} for name, part in assembly.parts.items()},
        "seats": _seats(assembly),
        "mirror_travel_deg": {name: round(value, 3) for name, value in layout.travel_deg.items()},
        "adjuster_deg_per_turn": {
            name: round(value * STOCK.screw_pitch_mm / STOCK.adjuster_travel_mm, 3)
            for name, value in layout.travel_deg.items()
        },
        "holes": [_bored(assembly, hole) for hole in assembly.holes],
    }
