"""The prism rig unfolded: each view is the real lens behind a glass plate, moved by two reflections.

One total reflection in an equilateral prism unfolds to a plane-parallel plate of thickness h (the prism's height),
square to the optical axis and the same for both views. The scene in front of it is the true scene reflected in the
mirror and then in the prism's reflecting face: a rigid motion, no mirror image is left. The plate moves the pinhole
along the axis by delta(t) = h (1 - cos t / sqrt(n^2 - sin^2 t)), t the angle from the axis, so a view is not quite a
pinhole; `paraxial_centre_mm` is the limit on the axis.

Frames. *rig*: see `rig`. *view*: the unfolded camera, origin in the paraxial pinhole, z along its optical axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError
from prismstereo_hw.optics.surfaces import Surface
from prismstereo_hw.view import Side

if TYPE_CHECKING:
    from prismstereo_hw.rig import Rig

__all__ = ["FoldedView", "fold", "unfold_mirrors"]

Array = NDArray[np.float64]
_NEWTON_ROUNDS = 12
_NEWTON_TOLERANCE = 1e-14


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
    def mirrored(self) -> bool:
        """Whether the view shows the scene's mirror image."""
        return bool(np.linalg.det(self.R) < 0)

    @property
    def centre_mm(self) -> Array:
        """The virtual pinhole (3,) in the rig frame: the paraxial one."""
        return self.paraxial_centre_mm

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
    """Return the exact closed form of one view of a rig; `RigError` for a rig whose glass does not unfold to a plate."""
    found = rig.folded(side)
    if found is None:
        raise RigError(
            f"rig {rig.name!r} has no closed form: its glass does not unfold to a plate, trace its rays instead"
        )
    return found


def unfold_mirrors(side: Side, surfaces: tuple[Surface, ...]) -> FoldedView | None:
    """Return the closed form of a view through mirrors alone (or through nothing): an exact pinhole; else None.

    An odd number of mirrors leaves the view mirrored: det R = -1.
    """
    if any(surface.action != "reflect" for surface in surfaces):
        return None
    R, t = np.eye(3), np.zeros(3)
    for surface in surfaces:  # the first mirror from the camera is the last to act on the scene
        A, b = surface.reflection()
        R, t = R @ A, R @ b + t
    return FoldedView(side, R, t, plate_mm=0.0, index=1.0)
