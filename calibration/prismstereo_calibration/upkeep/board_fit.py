"""A few numbers that change two calibrated cameras, fitted to boards that stand anywhere: each board's pose is eliminated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.detection import Sighting
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.solving.poses import board_poses, rotations

__all__ = ["BoardFit", "fit_boards"]

Array = NDArray[np.float64]
Cameras = tuple[Camera, Camera]
Pose = tuple[Array, Array]

_ROUNDS = 8
_POSE_STEPS = np.array([1e-6] * 3 + [1e-4] * 3)
_STEP = 1e-3
_CONVERGED = 1e-3
_SMALLEST_VARIANCE = 1e-4  # px^2


@dataclass(frozen=True, slots=True)
class BoardFit:
    """The numbers (k,), one standard deviation of each, and what is left over per two-dimensional point."""

    amounts: Array
    sigmas: Array
    rms_px: float


def fit_boards(seen: Sequence[Sighting], points: Array, cameras: Callable[[Array], Cameras], count: int) -> BoardFit:
    """Fit `count` numbers, with a normal prior of one each, that make left and right camera, and the poses of all boards.

    `points` (N, 3) are the board's; `CalibrationError` for corners that no pose of it explains.
    """
    amounts: Array = np.zeros(count)
    covariance: Array = np.eye(count)
    poses = [_first_pose(cameras(amounts), one, points) for one in seen]
    for _ in range(_ROUNDS):
        residuals = [_residual(cameras(amounts), pose, points, one) for pose, one in zip(poses, seen, strict=True)]
        variance = max(_SMALLEST_VARIANCE, float(np.mean(np.concatenate(residuals) ** 2)))
        parts = [_Part.of(cameras, amounts, pose, points, one) for pose, one in zip(poses, seen, strict=True)]
        normal = variance * np.eye(count) + sum((part.normal for part in parts), np.zeros((count, count)))
        right_side = variance * amounts + sum((part.right_side for part in parts), np.zeros(count))
        inverse = np.asarray(np.linalg.inv(normal), np.float64)
        covariance, change = variance * inverse, inverse @ right_side
        nudges = [part.back(change) for part in parts]
        poses = [_nudged(pose, -nudge) for pose, nudge in zip(poses, nudges, strict=True)]
        amounts = amounts - change
        if max(float(np.abs(step).max(initial=0.0)) for step in (change, *nudges)) < _CONVERGED:
            break
    both = cameras(amounts)
    left_over = np.concatenate([_residual(both, pose, points, one) for pose, one in zip(poses, seen, strict=True)])
    return BoardFit(amounts, np.sqrt(np.diag(covariance)), float(np.sqrt(2 * np.mean(left_over**2))))


@dataclass(frozen=True, slots=True)
class _Part:
    """What one board adds to the normal equations of the numbers, its pose (six numbers) eliminated."""

    solved: Array  # (6, M): what a residual does to the pose
    by_numbers: Array  # (M, k)
    residual: Array
    normal: Array
    right_side: Array

    @classmethod
    def of(cls, cameras: Callable[[Array], Cameras], amounts: Array, pose: Pose, points: Array, one: Sighting) -> _Part:
        both, k = cameras(amounts), len(amounts)
        residual = _residual(both, pose, points, one)

        def by_pose(numbers: Array) -> Array:
            return _residual(both, _nudged(pose, numbers), points, one)

        def by_amounts(numbers: Array) -> Array:
            return _residual(cameras(amounts + numbers), pose, points, one)

        A, B = _jacobian(by_pose, residual, _POSE_STEPS), _jacobian(by_amounts, residual, np.full(k, _STEP))
        solved = np.asarray(np.linalg.pinv(A), np.float64)
        free = B - A @ (solved @ B)
        return cls(solved, B, residual, free.T @ free, free.T @ residual)

    def back(self, change: Array) -> Array:
        """Return the change (6,) of the pose that goes with a change (k,) of the numbers."""
        return np.asarray(self.solved @ (self.residual - self.by_numbers @ change))


def _jacobian(residual: Callable[[Array], Array], here: Array, steps: Array) -> Array:
    columns = [(residual(step * unit) - here) / step for step, unit in zip(steps, np.eye(len(steps)), strict=True)]
    return np.stack(columns, axis=-1) if columns else np.zeros((len(here), 0))


def _nudged(pose: Pose, numbers: Array) -> Pose:
    return rotations(numbers[:3]) @ pose[0], pose[1] + numbers[3:]


def _residual(cameras: Cameras, pose: Pose, points: Array, one: Sighting) -> Array:
    """Return projected less measured, flat, of the corners that both views see."""
    there = points[one.shared] @ pose[0].T + pose[1]
    measured = one.left, one.right
    off = [camera.project(there) - pixels[one.shared] for camera, pixels in zip(cameras, measured, strict=True)]
    return np.concatenate(off).ravel()


def _first_pose(cameras: Cameras, one: Sighting, points: Array) -> Pose:
    """Return that of the poses which the left view allows that suits the right view better."""
    found = board_poses(points[one.shared], one.left[one.shared], cameras[0].lens)
    if not found:
        raise CalibrationError(f"{one.name} shows the board in a pose that cannot be: check its counts and its square")
    best = min(found, key=lambda pose: float(np.sum(_residual(cameras, (pose.R, pose.t), points, one) ** 2)))
    return best.R, best.t
