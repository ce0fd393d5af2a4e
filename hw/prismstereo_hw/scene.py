"""Scenes for the optical twin: textured things in the rig frame, at rest or moving, and the light on them.

Rig frame: origin in the entrance pupil, z forward, x right, y down, millimetres. A facing rectangle has its u axis along
x and its v axis along y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError
from prismstereo_hw.light import Light
from prismstereo_hw.optics.figures import common_strip_mm, common_width_mm
from prismstereo_hw.optics.outlook import outlook
from prismstereo_hw.optics.sight import sight
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Rig
from prismstereo_hw.shapes import sets
from prismstereo_hw.shapes.rectangle import Rectangle, board
from prismstereo_hw.shapes.shape import Array, Shape
from prismstereo_hw.shapes.stage import Stage
from prismstereo_hw.view import Side

__all__ = ["SCENES", "Light", "Rectangle", "Scene", "Shape", "board", "board_poses", "facing_plane", "named"]

SCENES = {
    "plane:MM": "one textured plane facing the rig at a distance, e.g. plane:500",
    "desk": "boxes' faces between the near end of the range and up to three times as far, one of them moving, a wall behind",
    "board:MM": "a chessboard of 9x7 corners facing the rig at a distance, a wall behind",
    "sphere:MM": "a turning ball whose nearest point is at a distance, a wall behind",
    "face": "a face that speaks at 1.1 times the near end of the range, a wall behind",
    "toy-car": "a toy car driving over a table at 1.35 times the near end of the range, soft shadows on table and wall",
    "street": "boxes on the ground from 3 to 20 m, one of them driving, a house front at 30 m",
}


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything the rig looks at; what meets no surface is as dark as `background_grey`.

    Without a light, surfaces are as bright as their textures.
    """

    name: str
    surfaces: tuple[Shape, ...]
    background_grey: float = 12.0
    light: Light | None = None

    def at(self, seconds: float) -> Scene:
        """Return the scene as it stands at a time."""
        return replace(
            self,
            surfaces=tuple(surface.at(seconds) for surface in self.surfaces),
            light=self.light and self.light.at(seconds),
        )

    def first_hit(self, origin: Array, direction: Array) -> tuple[Array, NDArray[np.int16]]:
        """Return the distance (N,) to the nearest surface along rays (N, 3), inf for none, and its index, -1 for none."""
        nearest = np.full(len(direction), np.inf)
        which = np.full(len(direction), -1, np.int16)
        for index, surface in enumerate(self.surfaces):
            reach = surface.distance(origin, direction)
            nearer = reach < nearest
            nearest[nearer], which[nearer] = reach[nearer], index
        return nearest, which

    def shade(self, origin: Array, direction: Array, way_mm: Array, focal_px: float) -> Array:
        """Return the grey level (N,) float64, 0 to 255, that each ray (N, 3), (N, 3) of unit direction brings.

        `way_mm` (N,) is how far light still goes from the origin to the pinhole; with the focal length in pixels it gives
        the size of the patch that a pixel averages over.
        """
        reach, which = self.first_hit(origin, direction)
        grey = np.full(len(reach), self.background_grey)
        pixel_mm = (reach + way_mm) / focal_px
        for index, surface in enumerate(self.surfaces):
            here = which == index
            if here.any():
                point = origin[here] + reach[here, None] * direction[here]
                grey[here] = surface.shade(point, pixel_mm[here])
                if self.light is not None:
                    share = self.light.share(point, surface.normals(point), direction[here], self._free_way)
                    grey[here] = np.minimum(grey[here] * share, 255.0)
        return grey

    def _free_way(self, origin: Array, direction: Array) -> Array:
        return self.first_hit(origin, direction)[0]


def facing_plane(rig: Rig, distance_mm: float, seed: int = 1) -> Scene:
    """Return one endless textured plane at z = `distance_mm` of the scene frame (see `optics.outlook`)."""
    plane = Stage.before(rig).facing("plane", (0.0, 0.0, distance_mm), (np.inf, np.inf), seed)
    return Scene(f"plane:{distance_mm:g}", (plane,))


def desk(rig: Rig, seed: int = 1) -> Scene:
    """Return a small still life within the rig's range: three faces, one of them moving, and a wall behind them."""
    near = 1.25 * rig.range.near_mm
    depth = max(1.1, min(3.0, 0.8 * rig.range.far_mm / near))  # of the wall, as a multiple of the nearest face
    size = near * math.tan(math.radians(rig.camera.hfov_deg / 4))
    book, screen, wall = (near * depth**part for part in (0.24, 0.535, 1.0))
    stage = Stage.before(rig)
    x = [stage.middle_mm(z) for z in (near, book, screen)]
    facing = stage.facing
    return Scene(
        "desk",
        (
            facing(
                "box", (x[0] - 0.25 * size, 0.2 * size, near), (0.22 * size, 0.28 * size), seed, (0.2 * size, 0.0, 0.0), 165
            ),
            facing("book", (x[1] + 0.45 * size, -0.1 * size, book), (0.3 * size, 0.25 * size), seed + 1, mean=90),
            facing("screen", (x[2], -0.3 * size, screen), (0.9 * size, 0.6 * size), seed + 2, mean=140),
            facing("wall", (0.0, 0.0, wall), (np.inf, np.inf), seed + 3),
        ),
    )  # fmt: skip


def _board_before_wall(rig: Rig, distance_mm: float, seed: int) -> sets.StageSet:
    stage, square = Stage.before(rig), board_square_mm(rig, distance_mm)
    first = stage.pose((stage.middle_mm(distance_mm) - 4 * square, -3 * square, distance_mm))
    wall = stage.facing("wall", (0.0, 0.0, 1.4 * distance_mm), (np.inf, np.inf), seed)
    return sets.StageSet((board(9, 7, square, first.R, first.centre_mm), wall))


_AT_A_DISTANCE = {"board": _board_before_wall, "sphere": sets.ball}
_SETS = {"face": sets.face, "toy-car": sets.toy_car, "street": sets.street}


def named(rig: Rig, name: str, seed: int = 1) -> Scene:
    """Return a scene by name (see `SCENES`), scaled to the rig's range; `UsageError` lists the names."""
    kind = name.partition(":")[0]
    if name == "desk":
        return desk(rig, seed)
    if name in _SETS:
        return _scene(name, _SETS[name](rig, seed))
    if kind == "plane":
        return facing_plane(rig, _distance_mm(rig, name), seed)
    if kind in _AT_A_DISTANCE:
        return _scene(name, _AT_A_DISTANCE[kind](rig, _distance_mm(rig, name), seed))
    raise UsageError(f"there is no scene {name!r}: choose one of {', '.join(SCENES)}")


def _scene(name: str, built: sets.StageSet) -> Scene:
    return Scene(name, built.shapes, built.background_grey, built.light)


def _distance_mm(rig: Rig, name: str) -> float:
    """Read the distance behind the colon of a scene's name; `UsageError` for one that is not before the rig."""
    kind, _, argument = name.partition(":")
    try:
        distance_mm = float(argument)
    except ValueError:
        distance_mm = math.nan
    front_mm = math.ceil(Stage.before(rig).front_mm())
    if not front_mm <= distance_mm <= 1e8:
        raise UsageError(
            f"scene {name!r}: give the distance in mm after the colon, beyond the rig itself and up to 1e8: "
            f"{front_mm} to 1e8, e.g. {kind}:500"
        )
    return distance_mm


def board_square_mm(rig: Rig, distance_mm: float, columns: int = 9) -> float:
    """Return a square size, in half millimetres, that lets a board fill six tenths of the common field at a distance."""
    return max(1.0, round(0.6 * common_width_mm(rig, distance_mm) * 2 / (columns + 3)) / 2)


def board_poses(
    rig: Rig, count: int, seed: int, *, columns: int = 9, rows: int = 7
) -> list[tuple[float, Array, Array]]:
    """Return seeded poses (square_mm, R, t_mm) of a calibration board, all corners in both views of the rig."""
    rng = np.random.default_rng(seed)
    near = rig.range.near_mm
    looking, square = outlook(rig), board_square_mm(rig, 1.05 * near, columns)
    centre_x = sum(common_strip_mm(rig, 1.2 * near)) / 2
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2) * square
    flat = np.column_stack([grid, np.zeros(len(grid))])
    poses: list[tuple[float, Array, Array]] = []
    for _ in range(400 * count):
        if len(poses) == count:
            return poses
        tilt = np.radians(rng.uniform([-30, -30, -12], [30, 30, 12]))
        R = _rotation(tilt)
        middle = np.array([*rng.uniform(-0.45, 0.45, 2) * near, near * rng.uniform(0.95, 1.5)])
        middle[0] += centre_x
        R = looking.R_rig_from_scene @ R
        t = looking.to_rig(middle) - R @ flat.mean(axis=0)
        if all(_in_view(rig, side, flat @ R.T + t) for side in ("left", "right")):
            poses.append((square, R, t))
    raise UsageError(f"no {count} board poses fit the common field of rig {rig.name!r}: see `prismstereo design`")


def _in_view(rig: Rig, side: Side, points: Array) -> bool:
    """Tell whether points (N, 3) of the rig frame are well inside a view: off its border, off the seam, lit."""
    video = rig.camera.video
    slopes = sight(rig, side).slopes(points)
    pixels = rig.lens().project_slopes(slopes)
    x, y, w, h = rig.views[0 if side == "left" else 1].rectangle(video.width, video.height)
    margin = 0.02 * video.width
    inside = np.all((pixels > [x + margin, y + margin]) & (pixels < [x + w - margin, y + h - margin]))
    return bool(inside) and not np.any(view_fates(rig, side, slopes).fate)


def _rotation(angles: Array) -> Array:
    (ca, cb, cc), (sa, sb, sc) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    about_z = np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)
