"""Flat things: a textured rectangle that may be endless, and the ground, which is looked along."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from prismstereo_hw.shapes.pose import Motion, Vector
from prismstereo_hw.shapes.shape import NEAREST_MM, Array
from prismstereo_hw.texture import Checkered, Texture

__all__ = ["Ground", "Rectangle", "board"]

_TAPS = 8  # samples along a pixel's footprint on the ground
_LONGEST = 24.0  # footprint, as a multiple of its width: at 2.4 degrees


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
    velocity_mm_s: Vector = (0.0, 0.0, 0.0)
    spin_deg_s: Vector = (0.0, 0.0, 0.0)  # axis through the centre times rate, see `Motion`

    @property
    def normal(self) -> Array:
        """Unit normal (3,)."""
        return np.cross(self.u, self.v)

    def at(self, seconds: float) -> Rectangle:
        """Return this rectangle where it is at a time."""
        motion = Motion(self.velocity_mm_s, self.spin_deg_s)
        turn = motion.turn(seconds)
        return replace(self, centre_mm=self.centre_mm + motion.shift_mm(seconds), u=turn @ self.u, v=turn @ self.v)

    def distance(self, origin: Array, direction: Array) -> Array:
        """Return how far along each ray (N, 3) this is met, (N,) mm; inf where it is not."""
        normal = self.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = ((self.centre_mm - origin) @ normal) / (direction @ normal)
            offset = origin + reach[:, None] * direction - self.centre_mm
            across, down = np.abs(offset @ self.u), np.abs(offset @ self.v)
        met = (reach > NEAREST_MM) & np.isfinite(reach) & (across <= self.half_u_mm) & (down <= self.half_v_mm)
        return np.where(met, reach, np.inf)

    def shade(self, point: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at points (N, 3) of this surface, seen by pixels of a size (N,) in mm."""
        offset = point - self.centre_mm
        u0, v0 = self.texture_origin_mm
        return self.texture.shade(offset @ self.u - u0, offset @ self.v - v0, pixel_mm)

    def normals(self, point: Array) -> Array:
        """Return the normal of the plane at each of the points (N, 3)."""
        return np.broadcast_to(self.normal, point.shape)


@dataclass(frozen=True, slots=True)
class Ground:
    """A plane seen at a grazing angle from about `eye_mm` (3,): a pixel's footprint on it is long, and averaged along.

    Without that the far ground would alias, and two views of it would not look alike.
    """

    plane: Rectangle
    eye_mm: Array

    @property
    def name(self) -> str:
        """What the plane is called."""
        return self.plane.name

    def at(self, seconds: float) -> Ground:
        """Return the ground where its plane is at a time."""
        return replace(self, plane=self.plane.at(seconds))

    def distance(self, origin: Array, direction: Array) -> Array:
        """Return how far along each ray (N, 3) the ground is met, (N,) mm; inf where it is not."""
        return self.plane.distance(origin, direction)

    def shade(self, point: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at points (N, 3), averaged over footprints that are `pixel_mm` (N,) across."""
        sight = point - self.eye_mm
        height = sight @ self.plane.normal
        along = sight - height[:, None] * self.plane.normal
        length = np.linalg.norm(along, axis=1)
        along /= np.maximum(length, 1e-9)[:, None]
        stretch = np.minimum(np.hypot(length, height) / np.maximum(np.abs(height), 1e-9), _LONGEST)
        fineness = pixel_mm * np.maximum(1.0, stretch / _TAPS)
        taps = (np.arange(_TAPS) + 0.5) / _TAPS - 0.5
        greys = [self.plane.shade(point + (tap * stretch * pixel_mm)[:, None] * along, fineness) for tap in taps]
        return np.asarray(np.mean(greys, axis=0))

    def normals(self, point: Array) -> Array:
        """Return the normal of the ground at each of the points (N, 3)."""
        return self.plane.normals(point)


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
