"""The light that must not be cut: every ray of both views, segment by segment, in the rig frame.

Taken with the product's own tracer. All pixels count, of the video mode and of the taller still, and the whole pupil,
its rim included. A ray that the optics themselves lose (it misses a mirror, or leaks through the prism) is none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.kinds import PrismRig
from prismstereo_hw.optics.trace import trace
from prismstereo_hw.rig import Mode
from prismstereo_hw.view import Side

__all__ = ["Bundle", "bundle"]

Array = NDArray[np.float64]
_GRID = (61, 41)
_PUPIL_RIM = 12


@dataclass(frozen=True, slots=True)
class Bundle:
    """One view's rays: `points_mm` (N, 5, 3) at pupil, base, reflecting face, exit face, mirror; `direction` (N, 3) out."""

    side: Side
    points_mm: Array
    direction: Array

    def at_height(self, y_mm: float, far_mm: float) -> Array:
        """Return where outgoing rays cross the level y: (M, 2) of x and z, up to z = `far_mm`."""
        start = self.points_mm[:, 4]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (y_mm - start[:, 1]) / self.direction[:, 1]
            crossing = start + distance[:, None] * self.direction
        crosses = np.isfinite(distance) & (distance >= 0) & (crossing[:, 2] < far_mm)
        return np.asarray(crossing[crosses][:, [0, 2]])

    def radius_at(self, z_mm: float) -> float:
        """Return how far from the axis the rays reach between pupil and prism at z."""
        pupil, base = self.points_mm[:, 0], self.points_mm[:, 1]
        share = z_mm / base[:, 2:]
        return float(np.hypot(*(pupil + share * (base - pupil))[:, :2].T).max())

    def meets_symmetry_plane_mm(self) -> float:
        """Return the least z at which an outgoing ray reaches x = 0."""
        start = self.points_mm[:, 4]
        with np.errstate(divide="ignore"):
            distance = -start[:, 0] / self.direction[:, 0]
        inward = distance > 0
        return float((start[:, 2] + distance * self.direction[:, 2])[inward].min(initial=np.inf))


def bundle(rig: PrismRig, side: Side) -> Bundle:
    """Trace one view of a rig, both modes."""
    video, still = (_rays(rig, mode) for mode in (rig.camera.video, rig.camera.still))
    origin, direction = (np.concatenate(pair) for pair in zip(video, still, strict=True))
    path = rig.surfaces(side)
    whole = trace(path, origin, direction)
    passes = whole.fate == 0
    origin, direction = origin[passes], direction[passes]
    points = [origin, *(trace(path[:count], origin, direction).point_mm for count in range(1, len(path) + 1))]
    return Bundle(side, np.stack(points, axis=1), whole.direction[passes])


def _rays(rig: PrismRig, mode: Mode) -> tuple[Array, Array]:
    columns, rows = np.linspace(0, mode.width - 1, _GRID[0]), np.linspace(0, mode.height - 1, _GRID[1])
    slopes = rig.lens(mode).slopes(np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2))
    slopes = slopes[np.isfinite(slopes).all(axis=1)]
    ahead = np.concatenate([slopes, np.ones_like(slopes[:, :1])], axis=1)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    turn = np.linspace(0, 2 * np.pi, _PUPIL_RIM, endpoint=False)
    rim = rig.camera.pupil_diameter_mm / 2 * np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    pupil = np.concatenate([np.zeros((1, 3)), rim])
    return np.repeat(pupil, len(ahead), axis=0), np.tile(ahead, (len(pupil), 1))
