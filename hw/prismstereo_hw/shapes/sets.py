"""What stands on the stage in the named scenes: a ball, a face that speaks, a toy car on a table, a street."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from prismstereo_hw.light import Light
from prismstereo_hw.rig import Rig
from prismstereo_hw.shapes.box import Box
from prismstereo_hw.shapes.face import Face
from prismstereo_hw.shapes.height_field import HeightField
from prismstereo_hw.shapes.mesh import Mesh
from prismstereo_hw.shapes.pose import Motion, Vector
from prismstereo_hw.shapes.shape import Shape
from prismstereo_hw.shapes.sphere import Sphere
from prismstereo_hw.shapes.stage import Stage
from prismstereo_hw.shapes.triangles import cylinder_triangles

__all__ = ["StageSet", "ball", "face", "street", "toy_car"]

_TOWARDS_LIGHT = (-0.5, -0.5, -0.7)  # up, to the left, from behind the rig
_FACING = np.diag([1.0, -1.0, -1.0])  # y up and z towards the rig, in the scene frame
_EYE_HEIGHT_MM = 1200.0  # of the street scene; less where the near boxes would be out of the picture
_TURNED_DEG = (0.0, 25.0, -15.0, 40.0, -30.0)  # of the street's boxes, about the vertical


class StageSet(NamedTuple):
    """Shapes, nearest kind of thing first, their light, and what is behind all of them."""

    shapes: tuple[Shape, ...]
    light: Light | None = None
    background_grey: float = 12.0


def _light(stage: Stage, shadow_rays: int = 0) -> Light:
    return Light(towards=stage.vector(_TOWARDS_LIGHT), shadow_rays=shadow_rays)


def ball(rig: Rig, distance_mm: float, seed: int) -> StageSet:
    """Return a ball whose nearest point is at a distance, slowly turning, and a wall behind it."""
    stage = Stage.before(rig)
    radius = min(0.7 * stage.half_width_mm(distance_mm), 0.3 * distance_mm)
    pose = stage.pose((stage.middle_mm(distance_mm), 0.0, distance_mm + radius))
    motion = Motion(spin_deg_s=stage.vector((0.0, 20.0, 0.0)))
    wall = stage.facing("wall", (0.0, 0.0, 1.2 * (distance_mm + 2 * radius)), (np.inf, np.inf), seed + 1)
    return StageSet((Sphere("ball", pose, radius, stage.noise(seed, distance_mm), motion), wall))


def face(rig: Rig, seed: int) -> StageSet:
    """Return a face that speaks, the tip of its nose at 1.1 times the near end of the range, and a wall behind it."""
    stage = Stage.before(rig)
    tip = 1.1 * rig.range.near_mm
    form = Face(head_mm=min(210.0, 2.2 * stage.half_width_mm(tip)))
    depth = float(form.height(np.zeros(1), np.array([-12.0 * form.head_mm / 210.0]))[0])
    pose = stage.pose((stage.middle_mm(tip), 0.0, tip + depth), _FACING)
    head = HeightField("face", pose, form, stage.noise(seed, tip, mean=140.0))
    wall = stage.facing("wall", (0.0, 0.0, 1.3 * (tip + depth)), (np.inf, np.inf), seed + 1, mean=110.0)
    return StageSet((head, wall), _light(stage))


def _car(stage: Stage, seed: int, x: float, floor: float, z: float, length: float, speed: float) -> Iterator[Shape]:
    """Yield body, cabin and wheels of a car that drives along x, standing on y = floor."""
    velocity = stage.vector((speed, 0.0, 0.0))
    rolling = Motion(velocity)
    wheel, width = 0.11 * length, 0.24 * length
    parts: list[tuple[str, Vector, Vector, float]] = [
        ("body", (x, floor - 1.9 * wheel, z), (length / 2, 0.9 * wheel, width), 175.0),
        ("cabin", (x - 0.06 * length, floor - 3.7 * wheel, z), (0.26 * length, 0.9 * wheel, 0.85 * width), 90.0),
    ]
    for offset, (name, centre, half, mean) in enumerate(parts):
        yield Box(name, stage.pose(centre), half, stage.noise(seed + offset, z, mean), rolling)
    tyre = cylinder_triangles(wheel, 0.25 * wheel)
    spin = stage.vector((0.0, 0.0, math.degrees(speed / wheel)))  # rolls: y is down, so forward is a turn from x to y
    for name, along, across in (("front", 0.3, -1), ("front far", 0.3, 1), ("back", -0.3, -1), ("back far", -0.3, 1)):
        pose = stage.pose((x + along * length, floor - wheel, z + across * width))
        yield Mesh(f"{name} wheel", pose, tyre, stage.noise(seed + 2, z, 70.0), motion=Motion(velocity, spin))


def toy_car(rig: Rig, seed: int) -> StageSet:
    """Return a toy car that drives to the right on a table before a wall, all at rest but the car, with soft shadows."""
    stage = Stage.before(rig)
    z = 1.35 * rig.range.near_mm
    half = stage.half_width_mm(z)
    length, floor = 1.2 * half, 0.5 * half
    car = _car(stage, seed, stage.middle_mm(z) - 0.3 * half, floor, z, length, 0.3 * half)
    table = stage.ground("table", floor, z, seed + 3, mean=150.0)
    wall = stage.facing("wall", (0.0, 0.0, 1.1 * z + 0.3 * length), (np.inf, np.inf), seed + 4)
    return StageSet((*car, table, wall), _light(stage, shadow_rays=6))


def street(rig: Rig, seed: int) -> StageSet:
    """Return a street from 3 to 30 m: five boxes on the ground, one of them driving, a house front, a grey sky."""
    stage = Stage.before(rig)
    shapes: list[Shape] = []
    below = min(_EYE_HEIGHT_MM, 0.6 * stage.half_height_mm(3300.0))
    for index, z in enumerate((3300.0, 5000.0, 8000.0, 13000.0, 20000.0)):
        half = stage.half_width_mm(z)
        side = (0.55, -0.6, 0.1, 0.6, -0.5)[index]
        wide, tall = min(0.25 * half, 1500.0), min(0.3 * half, 1800.0)
        angle = math.radians(_TURNED_DEG[index])
        R = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
        pose = stage.pose((stage.middle_mm(z) + side * half, below - tall, z), R)
        motion = Motion(stage.vector((min(1500.0, 0.4 * half), 0.0, 0.0)) if index == 2 else (0.0, 0.0, 0.0))
        texture = stage.noise(seed + index, z, mean=(150.0, 95.0, 130.0, 80.0, 165.0)[index])
        shapes.append(Box(f"box {index + 1}", pose, (wide, tall, 0.6 * wide), texture, motion))
    ground = stage.ground("ground", below, 5000.0, seed + 5)
    front = stage.facing("house front", (0.0, below - 5000.0, 30000.0), (20000.0, 5000.0), seed + 6)
    return StageSet((*shapes, ground, front), _light(stage), background_grey=200.0)
