"""The prism rig unfolded: each view is the real lens behind a glass plate, moved by two reflections.

One total reflection in an equilateral prism unfolds to a plane-parallel plate of thickness h (the prism's height),
square to the optical axis and the same for both views. The scene in front of it is the true scene reflected in the
mirror and then in the prism's reflecting face: a rigid motion, no mirror image is left. The plate moves the pinhole
along the axis by delta(t) = h (1 - cos t / sqrt(n^2 - sin^2 t)), t the angle from the axis, so a view is not quite a
pinhole; `paraxial_centre_mm` is the limit on the axis.

Frames. *rig*: see `rig`. *view*: the unfolded camera, origin in the paraxial pinhole, z along its optical axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

__all__ = ["FoldedView", "Plane", "fold", "mirror_plane", "reflecting_face"]

Array = NDArray[np.float64]
_NEWTON_ROUNDS = 12
_NEWTON_TOLERANCE = 1e-14


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane in the rig frame: a point on it (3,) in mm and its unit normal (3,)."""

    point_mm: Array
    normal: Array

    def reflection(self) -> tuple[Array, Array]:
        """Return A (3, 3) and b (3,) with X_reflected = A X + b."""
        A = np.eye(3) - 2 * np.outer(self.normal, self.normal)
        return A, 2 * self.normal * float(self.normal @ self.point_mm)


def _outward(side: Side) -> float:
    return -1.0 if side == "left" else 1.0


def mirror_plane(rig: Rig, side: Side) -> Plane:
    """Return the mirror through which a viewpoint looks, its normal towards the axis."""
    mirrors = rig.mirrors
    mu = math.radians(mirrors.angle_deg)
    tip = math.radians(mirrors.left_tip_deg if side == "left" else mirrors.right_tip_deg)
    s = _outward(side)
    level = np.array([-s * math.sin(mu), 0.0, math.cos(mu)])  # normal of the mirror as drawn
    normal = math.cos(tip) * level + math.sin(tip) * np.array([0.0, 1.0, 0.0])
    point = np.array([s * mirrors.near_edge_mm, 0.0, rig.prism.pupil_to_prism_mm + mirrors.offset_mm])
    return Plane(point, normal)


def reflecting_face(rig: Rig, side: Side) -> Plane:
    """Return the prism face that reflects a viewpoint's rays: the one on the other side, hence crossed views."""
    s = -_outward(side)
    apex = np.array([0.0, 0.0, rig.prism.pupil_to_prism_mm + rig.prism.height_mm])
    return Plane(apex, np.array([s * math.cos(math.pi / 6), 0.0, math.sin(math.pi / 6)]))


@dataclass(frozen=True, slots=True)
class FoldedView:
    """One view as a rigid motion and a glass plate.

    A point X of the rig frame stands at R X + t in the unfolded frame whose origin is the entrance pupil and whose
    plate has thickness `plate_mm` and index `index`.
    """

    side: Side
    R: Array
    t: Array
    plate_mm: float
    index: float

    @property
    def paraxial_shift_mm(self) -> float:
        """How far the plate moves the pinhole towards the scene, on the axis: h (1 - 1/n)."""
        return self.plate_mm * (1 - 1 / self.index)

    @property
    def paraxial_centre_mm(self) -> Array:
        """The virtual pinhole (3,) in the rig frame, on-axis limit."""
        return self.R.T @ (np.array([0.0, 0.0, self.paraxial_shift_mm]) - self.t)

    def view_from_rig(self, points: Array) -> Array:
        """Take rig points (..., 3) to the view frame, origin in the paraxial pinhole."""
        return np.asarray(points @ self.R.T + (self.t - np.array([0.0, 0.0, self.paraxial_shift_mm])))

    def slopes(self, points: Array) -> Array:
        """Project rig points (..., 3) exactly: ideal slopes (..., 2) of the real lens; NaN behind the plate.

        Solves (Z - h) u + h tan t' = R for u = tan t with sin t = n sin t', R the distance from the axis; the left
        side is concave and rising in u, so Newton's steps from the paraxial start converge at once.
        """
        X = points @ self.R.T + self.t
        radius = np.hypot(X[..., 0], X[..., 1])
        h, n2 = self.plate_mm, self.index**2
        beyond = np.where(X[..., 2] > h, X[..., 2] - h, np.nan)
        u = radius / (beyond + h / self.index)
        for _ in range(_NEWTON_ROUNDS):
            root = np.sqrt(n2 + (n2 - 1) * u * u)
            step = (beyond * u + h * u / root - radius) / (beyond + h * n2 / root**3)
            u = u - step
            if not np.nanmax(np.abs(step), initial=0.0) > _NEWTON_TOLERANCE:
                break
        off_axis = radius > 0
        scale = np.where(off_axis, u / np.where(off_axis, radius, 1.0), 1 / (beyond + h / self.index))
        return np.asarray(X[..., :2] * scale[..., None])

    def rays(self, slopes: Array) -> tuple[Array, Array]:
        """Take ideal slopes (..., 2) to rays in the rig frame: a point on each (..., 3) in mm and its direction (..., 3).

        The directions are unit vectors; the points lie on the optical axis of the unfolded camera.
        """
        direction = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
        direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
        cos_t = direction[..., 2]
        shift = self.plate_mm * (1 - cos_t / np.sqrt(self.index**2 - 1 + cos_t**2))
        on_axis = np.zeros_like(direction)
        on_axis[..., 2] = shift
        return (on_axis - self.t) @ self.R, direction @ self.R


def fold(rig: Rig, side: Side) -> FoldedView:
    """Return the exact closed form of one view of a prism rig (reference: Somanath 2010, section 3.2, made exact)."""
    A_mirror, b_mirror = mirror_plane(rig, side).reflection()
    A_face, b_face = reflecting_face(rig, side).reflection()
    return FoldedView(
        side=side,
        R=A_face @ A_mirror,
        t=A_face @ b_mirror + b_face,
        plate_mm=rig.prism.height_mm,
        index=rig.prism.index,
    )
