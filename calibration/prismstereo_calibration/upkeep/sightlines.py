"""Points that both views of a scene show, and the rays through them: what tells of a calibration without any board.

Two rays of one point meet. How far they pass each other, as an angle times the focal length, is the vertical disparity
that is left after rectification with that calibration, whatever the depth of the point and whatever glass is in the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration

__all__ = ["SceneMatches", "Sightlines"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SceneMatches:
    """The same points in both views of one frame: upright pixels (N, 2) float64 each; `name` is the frame's."""

    name: str
    left_px: Array
    right_px: Array

    def only(self, kept: NDArray[np.bool_]) -> SceneMatches:
        """Return the points (N,) that are kept."""
        return replace(self, left_px=self.left_px[kept], right_px=self.right_px[kept])


@dataclass(frozen=True, slots=True)
class Sightlines:
    """Rays of matched points: those of the left view in the left frame, those of the right view in the right camera's own.

    Points on the rays and unit directions (N, 3) each; `scene` (N,) says which frame a pair is from.
    """

    left_from: Array
    left_along: Array
    right_from: Array
    right_along: Array
    scene: NDArray[np.int64]
    focal_px: float

    @classmethod
    def of(cls, calibration: Calibration, scenes: Sequence[SceneMatches]) -> Sightlines:
        """Return the rays of all points of all scenes that both lenses can look through."""
        left_px, right_px = (
            np.concatenate([np.zeros((0, 2)), *(getattr(scene, side) for scene in scenes)])
            for side in ("left_px", "right_px")
        )
        own = Camera.at_origin(calibration.right.lens, calibration.right.plate)
        counts = [len(scene.left_px) for scene in scenes]
        return cls(
            *calibration.left.rays(left_px),
            *own.rays(right_px),
            np.repeat(np.arange(len(scenes)), counts),
            calibration.focal_px,
        )

    def only(self, kept: NDArray[np.bool_]) -> Sightlines:
        """Return the pairs (N,) that are kept."""
        return Sightlines(
            self.left_from[kept],
            self.left_along[kept],
            self.right_from[kept],
            self.right_along[kept],
            self.scene[kept],
            self.focal_px,
        )

    def rows_px(self, R: Array, t: Array) -> Array:
        """Return the vertical disparity (N,) in pixels if the right camera stands at R (3, 3), t (3,): right less left."""
        apart, b = (self.right_from - t) @ R - self.left_from, self.right_along @ R
        normal = np.cross(self.left_along, apart)  # down, where the right view is to the right
        return np.asarray(self.focal_px * np.sum(b * normal, axis=1) / np.linalg.norm(normal, axis=1))

    def met(self, R: Array, t: Array) -> Sightlines:
        """Return the pairs without vertical disparity, if the right camera stands at R, t: its rays bent onto the left ones.

        What is differentiated there tells of the pose alone; at the measured rays, noise would look smaller from some poses
        than from others.
        """
        apart, b = (self.right_from - t) @ R - self.left_from, self.right_along @ R
        normal = np.cross(self.left_along, apart)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        bent = b - np.sum(b * normal, axis=1, keepdims=True) * normal
        bent /= np.linalg.norm(bent, axis=1, keepdims=True)
        return replace(self, right_along=bent @ R.T)

    def nearness(self, R: Array, t: Array, ahead: Array) -> Array:
        """Return one over the depth (N,) at which each two rays pass nearest; 0 for parallel ones, below 0 if they part.

        Depth is that of every depth map: along the z axis of the rectified frame, from the pinholes. `ahead` (3,) is a
        direction of the left frame in its xz plane.
        """
        x = -R.T @ t
        x = x / np.linalg.norm(x)
        z = ahead - x * (ahead @ x)
        z = z / np.linalg.norm(z)
        apart, a, b = (self.right_from - t) @ R - self.left_from, self.left_along, self.right_along @ R
        cosine = np.sum(a * b, axis=1)
        sine2 = 1 - cosine**2
        from_left = np.sum(a * apart, axis=1) - cosine * np.sum(b * apart, axis=1)  # reach along a, times sine2
        from_right = cosine * np.sum(a * apart, axis=1) - np.sum(b * apart, axis=1)
        middle = (
            from_left * (a @ z) + from_right * (b @ z)
        ) / 2  # of the depths from the rays' own points, times sine2
        begin = ((self.left_from @ z) + (self.left_from + apart) @ z) / 2
        return np.asarray(sine2 / (middle + begin * sine2))
