"""What one viewpoint sees, whatever stands before the lens: rays out, points in.

`sight` gives the exact closed form where the rig has one (mirrors, or glass that unfolds to a plate), and otherwise traces
its rays and finds a point's pixel by Newton's method on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError
from prismstereo_hw.optics.surfaces import Surface
from prismstereo_hw.optics.trace import trace, view_fates
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

__all__ = ["Sight", "TracedView", "best_common_point", "lit_slopes", "sight"]

Array = NDArray[np.float64]
_NEWTON_ROUNDS = 12
_NEWTON_STEP = 1e-6
_NEWTON_TOLERANCE = 1e-13
_GRID = (48, 28)


class Sight(Protocol):
    """One view: a frame of its own (`R`, `centre_mm`), its rays, and where points fall.

    View frame: origin in the virtual pinhole, z along the optical axis; X_view = R (X - centre). det R = -1 where the
    view is a mirror image.
    """

    @property
    def side(self) -> Side:
        """Which viewpoint this is."""
        ...

    @property
    def R(self) -> Array:
        """R_view_from_rig (3, 3)."""
        ...

    @property
    def centre_mm(self) -> Array:
        """The virtual pinhole (3,) in the rig frame."""
        ...

    @property
    def mirrored(self) -> bool:
        """Whether the view shows the scene's mirror image."""
        ...

    def view_from_rig(self, points: Array) -> Array:
        """Take rig points (..., 3) to the view frame."""
        ...

    def slopes(self, points: Array) -> Array:
        """Project rig points (..., 3) exactly: ideal slopes (..., 2) of the real lens, NaN where there are none."""
        ...

    def rays(self, slopes: Array) -> tuple[Array, Array]:
        """Take ideal slopes (..., 2) to rays in the rig frame: a point on each and its unit direction (..., 3)."""
        ...


@dataclass(frozen=True, slots=True)
class TracedView:
    """A view without a closed form; its frame is the rigid motion that fits its rays best."""

    side: Side
    surfaces: tuple[Surface, ...]
    R: Array
    centre_mm: Array

    @property
    def mirrored(self) -> bool:
        """Whether the view shows the scene's mirror image."""
        return bool(np.linalg.det(self.R) < 0)

    def view_from_rig(self, points: Array) -> Array:
        """Take rig points (..., 3) to the view frame."""
        return np.asarray((points - self.centre_mm) @ self.R.T)

    def rays(self, slopes: Array) -> tuple[Array, Array]:
        """Take ideal slopes (..., 2) to rays behind the last surface: a point on each and its unit direction (..., 3)."""
        traced = trace(self.surfaces, np.zeros(3), _directions(slopes))
        return traced.point_mm, traced.direction

    def slopes(self, points: Array) -> Array:
        """Project rig points (..., 3): Newton's method on the distance by which the traced ray misses the point."""
        seen = self.view_from_rig(points)
        ahead = np.where(seen[..., 2] > 0, seen[..., 2], np.nan)
        slopes = seen[..., :2] / ahead[..., None]
        for _ in range(_NEWTON_ROUNDS):
            miss = self._miss(slopes, points)
            by = [(self._miss(slopes + step, points) - miss) / _NEWTON_STEP for step in _NEWTON_STEP * np.eye(2)]
            (a, c), (b, d) = ((column[..., 0], column[..., 1]) for column in by)
            change = np.stack([d * miss[..., 0] - b * miss[..., 1], a * miss[..., 1] - c * miss[..., 0]], axis=-1)
            change = change / (a * d - b * c)[..., None]
            slopes = slopes - change
            if not np.nanmax(np.abs(change), initial=0.0) > _NEWTON_TOLERANCE:
                break
        return np.asarray(slopes)

    def _miss(self, slopes: Array, points: Array) -> Array:
        """Return, in the view frame's slopes, how far beside the point the ray passes at the point's depth."""
        origin, direction = self.rays(slopes)
        o, d, p = self.view_from_rig(origin), direction @ self.R.T, self.view_from_rig(points)
        at = o + ((p - o)[..., 2] / d[..., 2])[..., None] * d
        return np.asarray((at - p)[..., :2] / p[..., 2:])


def _directions(slopes: Array) -> Array:
    direction = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
    return np.asarray(direction / np.linalg.norm(direction, axis=-1, keepdims=True))


def sight(rig: Rig, side: Side) -> Sight:
    """Return what one viewpoint of a rig sees."""
    folded = rig.folded(side)
    if folded is not None:
        return folded
    slopes = lit_slopes(rig, side)
    traced = trace(rig.surfaces(side), np.zeros(3), _directions(slopes))
    centre, _ = best_common_point(traced.point_mm, traced.direction)
    U, _, V = np.linalg.svd(_directions(slopes).T @ traced.direction)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V  # glass alone mirrors nothing
    return TracedView(side, rig.surfaces(side), R, centre)


def lit_slopes(rig: Rig, side: Side, *, middle_row: bool = False) -> Array:
    """Return the slopes (N, 2) of a view's pixels through which light comes: its middle row, or a grid over all of it.

    `RigError` where there is no light at all.
    """
    lens, video = rig.lens(), rig.camera.video
    x, y, w, h = rig.views[0 if side == "left" else 1].rectangle(video.width, video.height)
    columns = np.arange(x, x + w, dtype=float) if middle_row else np.linspace(x, x + w - 1, _GRID[0])
    rows = np.array([lens.cy_px]) if middle_row else np.linspace(y, y + h - 1, _GRID[1])
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    slopes = lens.slopes(grid)
    kept = slopes[view_fates(rig, side, slopes).fate == 0]
    if len(kept) < 2:
        raise RigError(f"rig {rig.name!r} shows nothing in its {side} view: see `prismstereo design` for its limits")
    return np.asarray(kept)


def best_common_point(origin: Array, direction: Array) -> tuple[Array, Array]:
    """Return the point (3,) nearest to all rays (N, 3), least squares, and the distance (N,) of each ray from it."""
    projectors = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    point = np.linalg.solve(projectors.sum(axis=0), np.einsum("nij,nj->i", projectors, origin))
    return point, np.linalg.norm(np.cross(origin - point, direction), axis=1)
