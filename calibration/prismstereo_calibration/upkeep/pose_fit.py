"""Where the right camera stands now, by the rows of a scene and, if one is given, by a known distance.

Unknown are the amounts by which the mount gave way and the sizes of the calibration's own errors (`doubts`), each with a
normal prior of one standard deviation; measured are the vertical disparities, with a robust weight each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.upkeep.mount import Mount
from prismstereo_calibration.upkeep.sightlines import Sightlines

__all__ = ["KnownDepth", "Pose", "PoseFit", "fit_pose", "spread"]

Array = NDArray[np.float64]
Pose = tuple[Array, Array]
_ROUNDS = 12
_STEP = 1e-3  # of a standard deviation of the mount
_SOFT = 2.4  # sigmas at which a residual counts half (Cauchy)
_MAD = 1.4826
_SMALLEST_SIGMA_PX = 0.01
_CONVERGED = 1e-3
_FAR_STEP = 0.05  # sigmas after which rows answer a little differently
_SHARED_PX = 0.1  # what matches have in common: shades of the texture, the lens between the corners of the board
_UNKNOWN_PX = 0.015  # rows that neither noise nor a lens model explains, all over the view
_SEEN_PX = 0.2  # noise against which a move of one sigma counts as seen


@dataclass(frozen=True, slots=True)
class KnownDepth:
    """Pairs of points whose depth, the median of all, was measured; both numbers in the calibration's unit.

    `ahead` (3,) is the z axis of the rectified frame in the left camera's.
    """

    lines: Sightlines
    depth: float
    sigma: float
    ahead: Array

    def off_px(self, R: Array, t: Array) -> float:
        """Return the disparity by which the middle of the points is nearer than was measured, in pixels."""
        nearness = float(np.median(self.lines.nearness(R, t, self.ahead)))
        return (nearness - 1 / self.depth) * self._scale_px(t)

    def sigma_px(self, match_px: float, t: Array) -> float:
        """Return one standard deviation of `off_px` for a standard deviation of each match."""
        return float(
            np.hypot(1.25 * match_px / np.sqrt(len(self.lines.scene)), self.sigma * self._scale_px(t) / self.depth**2)
        )

    def _scale_px(self, t: Array) -> float:
        return self.lines.focal_px * float(np.linalg.norm(t))


@dataclass(frozen=True, slots=True)
class PoseFit:
    """The pose found, the amounts (k,) in sigmas of the mount, their covariance (k, k), and the noise of a match."""

    R: Array
    t: Array
    amounts: Array
    covariance: Array
    sigma_px: float


def spread(residuals: Array) -> float:
    """Return a robust standard deviation of residuals (N,) about 0."""
    return max(_SMALLEST_SIGMA_PX, _MAD * float(np.median(np.abs(residuals))))


def fit_pose(lines: Sightlines, doubts: Array, right: Camera, mount: Mount, known: KnownDepth | None = None) -> PoseFit:
    """Find how a mount gave way from rays (N pairs), the patterns (N, q) of doubts, and the right camera as it was."""
    k, q = len(mount.ways), doubts.shape[1]
    numbers, covariance = np.zeros(k + q + k), np.eye(k + q + k)
    by_amounts = _row_slopes(lines.met(*mount.moved(right, np.zeros(k))), right, mount, np.zeros(k))
    seeming = np.concatenate([np.eye(k), _seeming(by_amounts, doubts)], axis=1)
    sigma_px = 1.0
    for _ in range(_ROUNDS):
        pose = mount.moved(right, seeming @ numbers)
        residual = lines.rows_px(*pose)
        sigma_px = spread(residual)
        weight = 1 / (1 + (residual / (_SOFT * sigma_px)) ** 2) / (sigma_px**2 + _SHARED_PX**2)
        weighted = by_amounts * weight[:, None]
        normal = seeming.T @ (weighted.T @ by_amounts) @ seeming + np.eye(k + q + k)
        right_side = seeming.T @ (weighted.T @ residual) + numbers
        if known is not None:
            normal, right_side = _with_known(known, right, mount, numbers[:k], sigma_px, normal, right_side)
        covariance = np.linalg.inv(normal)
        step = covariance @ right_side
        numbers = numbers - step
        if np.abs(step).max() < _CONVERGED:
            break
        if np.abs(step).max() > _FAR_STEP:
            pose = mount.moved(right, seeming @ numbers)
            by_amounts = _row_slopes(lines.met(*pose), right, mount, seeming @ numbers)
    R, t = mount.moved(right, numbers[:k])
    return PoseFit(R, t, numbers[:k], covariance[:k, :k], sigma_px)


def _seeming(by_amounts: Array, doubts: Array) -> Array:
    """Return the amounts (k, q + k) by which a mount seems to have given way for one sigma of each doubt.

    The patterns (N, q) themselves are nearly those of the mount's own moves (N, k); told apart point by point, they would be
    told apart by the noise of the points. The last k doubts are what no lens model knows of: any move may be feigned by rows
    that are off by a hundredth of a pixel, however many points there are.
    """
    normal = by_amounts.T @ by_amounts + _SEEN_PX**2 * np.eye(by_amounts.shape[1])
    pattern_px = np.sqrt(np.mean(by_amounts**2, axis=0))
    feigned = np.diag(_UNKNOWN_PX / np.maximum(pattern_px, _UNKNOWN_PX))
    return np.concatenate([np.linalg.solve(normal, by_amounts.T @ doubts), feigned], axis=1)


def _row_slopes(met: Sightlines, right: Camera, mount: Mount, amounts: Array) -> Array:
    """Differentiate the rows of rays that meet by the amounts: (N, k)."""
    return _slopes(lambda tried: met.rows_px(*mount.moved(right, tried)), amounts, np.zeros(len(met.scene)))


def _slopes(measured: Callable[[Array], Array], amounts: Array, here: Array) -> Array:
    """Differentiate (N,) by the amounts: (N, k)."""
    return np.stack([(measured(amounts + _STEP * unit) - here) / _STEP for unit in np.eye(len(amounts))], axis=-1)


def _with_known(
    known: KnownDepth, right: Camera, mount: Mount, amounts: Array, match_px: float, normal: Array, right_side: Array
) -> Pose:
    """Add the equation of a known depth to the normal equations."""

    def off(amounts: Array) -> Array:
        return np.array([known.off_px(*mount.moved(right, amounts))])

    here = off(amounts)
    gradient = np.zeros(len(normal))
    gradient[: len(amounts)] = _slopes(off, amounts, here)[0]
    weight = known.sigma_px(match_px, right.t_camera_from_left) ** -2
    return normal + weight * np.outer(gradient, gradient), right_side + weight * gradient * here[0]
