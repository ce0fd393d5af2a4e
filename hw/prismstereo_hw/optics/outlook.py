"""Where a rig looks: the frame in which scenes are put before it.

Scene frame: z along the middle of both views, y down, x to the right, millimetres. Its origin is the entrance pupil for
rigs that look forward (then it *is* the rig frame, as long as they are symmetric), and halfway between the virtual
pinholes for those that look elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.optics.sight import lit_slopes, sight
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

__all__ = ["Outlook", "outlook"]

Array = NDArray[np.float64]
_SIDES: tuple[Side, Side] = ("left", "right")
_STRAIGHT = 1e-9
_FORWARD = 0.9  # cosine of the angle up to which a rig counts as looking forward


@dataclass(frozen=True, slots=True)
class Outlook:
    """The scene frame in the rig frame: X_rig = R_rig_from_scene X_scene + origin."""

    R_rig_from_scene: Array
    origin_mm: Array

    def to_rig(self, points: Array) -> Array:
        """Take scene points (..., 3) to the rig frame."""
        return np.asarray(points @ self.R_rig_from_scene.T + self.origin_mm)

    def to_scene(self, points: Array) -> Array:
        """Take rig points (..., 3) to the scene frame."""
        return np.asarray((points - self.origin_mm) @ self.R_rig_from_scene)


def outlook(rig: Rig) -> Outlook:
    """Return where a rig looks."""
    views = [sight(rig, side) for side in _SIDES]
    ahead = np.zeros(3)
    for view, side in zip(views, _SIDES, strict=True):
        _, direction = view.rays(lit_slopes(rig, side, middle_row=True))
        middle = direction[[0, -1]].sum(axis=0)
        ahead += middle / np.linalg.norm(middle)
    ahead /= np.linalg.norm(ahead)
    if np.linalg.norm(ahead - [0, 0, 1]) < _STRAIGHT:
        return Outlook(np.eye(3), np.zeros(3))
    y = np.array([0.0, 1.0, 0.0])
    x = np.cross(y, ahead)
    R = np.stack([x, y, ahead], axis=1)
    forward = ahead[2] > _FORWARD
    return Outlook(R, np.zeros(3) if forward else (views[0].centre_mm + views[1].centre_mm) / 2)
