"""Scenes for the optical twin: textured rectangles and boards in the rig frame, at rest or moving straight on.

Rig frame: origin in the entrance pupil, z forward, x right, y down, millimetres. A facing rectangle has its u axis along
x and its v axis along y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError
from prismstereo_hw.optics.figures import common_strip_mm, common_width_mm
from prismstereo_hw.optics.outlook import outlook
from prismstereo_hw.optics.sight import sight
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Rig
from prismstereo_hw.texture import Checkered, Noise, Texture
from prismstereo_hw.view import Side

__all__ = ["SCENES", "Rectangle", "Scene", "board", "board_poses", "facing_plane", "named"]

Array = NDArray[np.float64]

SCENES = {
    "plane:MM": "one textured plane facing the rig at a distance, e.g. plane:500",
    "desk": "boxes' faces between the near end of the range and up to three times as far, one of them moving, a wall behind",
    "board:MM": "a chessboard of 9x7 corners facing the rig at a distance, a wall behind",
}


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A flat textured thing: centre (3,) mm, unit vectors u and v (3,) in its plane, half sizes in mm (may be inf)."""

    name: str
    centre_mm: Array
    u: Array
    v: Array
    half_u_mm: float
    half_v_mm: float
    texture: Texture
    texture_origin_mm: tuple[float, float] = (0.0, 0.0)  # in u, v from the centre
    velocity_mm_s: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def normal(self) -> Array:
        """Unit normal (3,)."""
        return np.cross(self.u, self.v)

    def at(self, seconds: float) -> Rectangle:
        """Return this rectangle where it is at a time."""
        return replace(self, centre_mm=self.centre_mm + seconds * np.asarray(self.velocity_mm_s))

    def distance(self, origin: Array, direction: Array) -> Array:
        """Return how far along each ray (N, 3) this is met, (N,) mm; inf where it is not."""
        normal = self.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = ((self.centre_mm - origin) @ normal) / (direction @ normal)
            offset = origin + reach[:, None] * direction - self.centre_mm
            across, down = np.abs(offset @ self.u), np.abs(offset @ self.v)
        met = (reach > 1e-6) & np.isfinite(reach) & (across <= self.half_u_mm) & (down <= self.half_v_mm)
        return np.where(met, reach, np.inf)

    def shade(self, point: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at points (N, 3) of this surface, seen by pixels of a size (N,) in mm."""
        offset = point - self.centre_mm
        u0, v0 = self.texture_origin_mm
        return self.texture.shade(offset @ self.u - u0, offset @ self.v - v0, pixel_mm)


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything the rig looks at; what meets no surface is as dark as `background_grey`."""

    name: str
    surfaces: tuple[Rectangle, ...]
    background_grey: float = 12.0

    def at(self, seconds: float) -> Scene:
        """Return the scene as it stands at a time."""
        return replace(self, surfaces=tuple(surface.at(seconds) for surface in self.surfaces))

    def first_hit(self, origin: Array, direction: Array) -> tuple[Array, NDArray[np.int16]]:
        """Return the distance (N,) to the nearest surface along rays (N, 3), inf for none, and its index, -1 for none."""
        nearest = np.full(len(direction), np.inf)
        which = np.full(len(direction), -1, np.int16)
        for index, surface in enumerate(self.surfaces):
            reach = surface.distance(origin, direction)
            nearer = reach < nearest
            nearest[nearer], which[nearer] = reach[nearer], index
        return nearest, which


def _texel_mm(rig: Rig, distance_mm: float) -> float:
    return distance_mm / rig.lens().fx_px / 2  # half a video pixel: the finest detail a sensor could see


def _facing(
    rig: Rig, name: str, centre: tuple[float, float, float], half: tuple[float, float], seed: int,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0), mean: float = 120.0,
) -> Rectangle:  # fmt: skip
    """Make a rectangle that faces the rig; centre and velocity are those of the scene frame."""
    looking = outlook(rig)
    x, y, _ = (looking.R_rig_from_scene @ axis for axis in np.eye(3))
    dx, dy, dz = looking.R_rig_from_scene @ np.array(velocity)
    return Rectangle(
        name=name,
        centre_mm=looking.to_rig(np.array(centre)),
        u=x,
        v=y,
        half_u_mm=half[0],
        half_v_mm=half[1],
        texture=Noise(seed=seed, texel_mm=_texel_mm(rig, centre[2]), mean=mean),
        velocity_mm_s=(float(dx), float(dy), float(dz)),
    )


def facing_plane(rig: Rig, distance_mm: float, seed: int = 1) -> Scene:
    """Return one endless textured plane at z = `distance_mm` of the scene frame (see `optics.outlook`)."""
    return Scene(f"plane:{distance_mm:g}", (_facing(rig, "plane", (0.0, 0.0, distance_mm), (np.inf, np.inf), seed),))


def board(columns: int, rows: int, square_mm: float, R: Array, t_mm: Array, *, name: str = "board") -> Rectangle:
    """Return a chessboard whose first inner corner lies at t (3,) and whose axes are the columns of R (3, 3).

    A board point X_board = (i square, j square, 0) stands at R X_board + t in the rig frame.
    """
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2]) * square_mm
    texture = Checkered(columns=columns, rows=rows, square_mm=square_mm)
    return Rectangle(
        name=name,
        centre_mm=t_mm + R[:, :2] @ middle,
        u=R[:, 0],
        v=R[:, 1],
        half_u_mm=((columns + 1) / 2 + texture.margin_squares) * square_mm,
        half_v_mm=((rows + 1) / 2 + texture.margin_squares) * square_mm,
        texture=texture,
        texture_origin_mm=(-middle[0], -middle[1]),
    )


def desk(rig: Rig, seed: int = 1) -> Scene:
    """Return a small still life within the rig's range: three faces, one of them moving, and a wall behind them."""
    near = 1.25 * rig.range.near_mm
    depth = max(1.1, min(3.0, 0.8 * rig.range.far_mm / near))  # of the wall, as a multiple of the nearest face
    size = near * math.tan(math.radians(rig.camera.hfov_deg / 4))
    book, screen, wall = (near * depth**part for part in (0.24, 0.535, 1.0))
    x = [sum(common_strip_mm(rig, z)) / 2 for z in (near, book, screen)]  # the middle of what both views see
    return Scene(
        "desk",
        (
            _facing(
                rig, "box", (x[0] - 0.25 * size, 0.2 * size, near), (0.22 * size, 0.28 * size), seed,
                (0.2 * size, 0.0, 0.0), 165,
            ),
            _facing(rig, "book", (x[1] + 0.45 * size, -0.1 * size, book), (0.3 * size, 0.25 * size), seed + 1, mean=90),
            _facing(rig, "screen", (x[2], -0.3 * size, screen), (0.9 * size, 0.6 * size), seed + 2, mean=140),
            _facing(rig, "wall", (0.0, 0.0, wall), (np.inf, np.inf), seed + 3),
        ),
    )  # fmt: skip


def named(rig: Rig, name: str, seed: int = 1) -> Scene:
    """Return a scene by name (see `SCENES`), scaled to the rig's range; `UsageError` lists the names."""
    kind, _, argument = name.partition(":")
    if kind == "desk" and not argument:
        return desk(rig, seed)
    if kind in ("plane", "board"):
        try:
            distance_mm = float(argument)
        except ValueError:
            distance_mm = math.nan
        front_mm = math.ceil(_front_mm(rig))
        if not front_mm <= distance_mm <= 1e8:
            raise UsageError(
                f"scene {name!r}: give the distance in mm after the colon, beyond the rig itself and up to 1e8: "
                f"{front_mm} to 1e8, e.g. {kind}:500"
            )
        if kind == "plane":
            return facing_plane(rig, distance_mm, seed)
        square, looking = board_square_mm(rig, distance_mm), outlook(rig)
        middle = sum(common_strip_mm(rig, distance_mm)) / 2
        first = looking.to_rig(np.array([middle - 4 * square, -3 * square, distance_mm]))
        wall = _facing(rig, "wall", (0.0, 0.0, 1.4 * distance_mm), (np.inf, np.inf), seed)
        return Scene(name, (board(9, 7, square, looking.R_rig_from_scene, first), wall))
    raise UsageError(f"there is no scene {name!r}: choose one of {', '.join(SCENES)}")


def _front_mm(rig: Rig) -> float:
    """Return how far the rig itself reaches towards the scene: its lens, or the farthest corner of a prism or mirror."""
    looking = outlook(rig)
    corners = [looking.to_scene(np.zeros(3))] + [
        looking.to_scene(part.centre_mm + s * part.half_along_mm * part.along)
        for side in ("left", "right")
        for part in rig.surfaces(side)
        for s in (-1, 1)
    ]
    return max(1.0, *(float(corner[2]) for corner in corners))


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
