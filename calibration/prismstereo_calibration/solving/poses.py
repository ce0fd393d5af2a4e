"""Rotations, the pose of a board in one view, and the pose of one view from the other that the frames agree on.

A flat board seen in a narrow field has two poses that look nearly alike. Both are kept until something else decides: the
other view, or what the other frames say.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.lens import Lens

__all__ = ["Consensus", "Pose", "agreed", "angle_deg", "board_poses", "rotation", "rotations"]

Array = NDArray[np.float64]
_CAP_DEG = 20.0  # beyond this a frame is wrong, however far
_TINY = 1e-12


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid motion: X_there = R X_here + t, R (3, 3), t (3,)."""

    R: Array
    t: Array

    def after(self, first: Pose) -> Pose:
        """Return the motion that does `first`, then this one."""
        return Pose(self.R @ first.R, self.R @ first.t + self.t)

    def inverse(self) -> Pose:
        """Return the motion back."""
        return Pose(self.R.T, -self.R.T @ self.t)


def rotations(turns: Array) -> Array:
    """Return the rotations (..., 3, 3) about axes (..., 3) by their lengths in radians (Rodrigues' formula)."""
    angle = np.linalg.norm(turns, axis=-1)[..., None, None]
    x, y, z = turns[..., 0], turns[..., 1], turns[..., 2]
    o = np.zeros_like(x)
    W = np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], axis=-2)
    safe = np.maximum(angle, _TINY)
    half = np.sin(safe / 2) / safe
    first = np.where(angle > _TINY, np.sin(safe) / safe, 1.0)
    return np.asarray(np.eye(3) + first * W + 2 * half * half * (W @ W))


def rotation(R: Array) -> Array:
    """Return the rotation nearest to R (3, 3): takes away what many small steps have added up to."""
    U, _, V = np.linalg.svd(R)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V)


def angle_deg(A: Array, B: Array) -> float:
    """Return the angle in degrees between two rotations (3, 3)."""
    chord = np.linalg.norm(A - B) / (2 * math.sqrt(2))
    return math.degrees(2 * math.asin(min(1.0, float(chord))))


def board_poses(points: Array, pixels: Array, lens: Lens) -> tuple[Pose, ...]:
    """Return the poses of a flat board, points (N, 3), that its pixels (N, 2) allow: one or two, the better first."""
    slopes = np.ascontiguousarray(lens.slopes(pixels))
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            np.ascontiguousarray(points), slopes, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return ()
    poses = (
        Pose(rotations(np.ravel(turn)), np.ravel(shift).astype(np.float64))
        for turn, shift in zip(turns, shifts, strict=True)
    )
    return tuple(pose for pose in poses if np.isfinite(pose.R).all() and np.isfinite(pose.t).all() and pose.t[2] > 0)


@dataclass(frozen=True, slots=True)
class Consensus:
    """The pose of the right view from the left that most frames agree on, and how far each is off in degrees (V,)."""

    pose: Pose
    off_deg: Array


def agreed(left: list[tuple[Pose, ...]], right: list[tuple[Pose, ...]]) -> Consensus:
    """Find the relative pose that the frames, each with its possible board poses in both views, agree on best."""
    candidates = [
        [b.after(a.inverse()) for a in of_left for b in of_right] for of_left, of_right in zip(left, right, strict=True)
    ]
    everything = [pose for frame in candidates for pose in frame]
    if not everything:
        raise CalibrationError("no frame shows the board in a pose that can be: check the board's size and the frames")
    rotations_of = np.stack([pose.R for pose in everything])
    chord = np.linalg.norm(rotations_of[:, None] - rotations_of[None], axis=(2, 3)) / (2 * math.sqrt(2))
    angles = np.degrees(2 * np.arcsin(np.minimum(chord, 1.0)))  # between every two candidates
    owner = np.concatenate([np.full(len(frame), index) for index, frame in enumerate(candidates)])
    nearest = np.stack([_least(angles[:, owner == index]) for index in range(len(candidates))], axis=1)
    best = int(np.argmin(np.minimum(nearest, _CAP_DEG).sum(axis=1)))
    off_deg = nearest[best]
    close = [
        min(frame, key=lambda pose: angle_deg(pose.R, everything[best].R))
        for frame, off in zip(candidates, off_deg, strict=True)
        if off < _CAP_DEG
    ]
    R = rotation(np.sum([pose.R for pose in close], axis=0))
    return Consensus(Pose(R, np.median([pose.t for pose in close], axis=0)), off_deg)


def _least(angles: Array) -> Array:
    """Return the least of each row; the greatest angle there is for a frame without candidates."""
    return angles.min(axis=1) if angles.shape[1] else np.full(len(angles), 180.0)
