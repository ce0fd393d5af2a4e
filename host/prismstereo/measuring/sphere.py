"""The ball in a patch of a relief: centre and radius that meet the matched disparities best.

A pixel's ray meets the ball at depth z; what is held against the map is scale / z, for its noise is even there. Fits of
distances from the centre would weigh the noisy rim, where the surface turns away, like the middle, and make balls too small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.measuring.calibration_share import MOST_POINTS, point_gradients, sigma_along
from prismstereo.measuring.clustered import MOST_PIXELS, covariance
from prismstereo.measuring.measured import Measured
from prismstereo.measuring.patch import Patch
from prismstereo.measuring.relief import Relief
from prismstereo_hw.errors import UsageError

__all__ = ["Sphere", "fit_sphere"]

Array = NDArray[np.float64]
_FEWEST = 100
_TRIALS, _SAMPLE = 600, 1500
_NEAR_PX = 0.5
_LEAST_SHARE = 0.15
_LEAST_BULGE_PX = 0.25  # of the middle over the border, in disparity: with less, nothing round was seen
_ROUNDS = 12
_TRIM, _LEAST_TRIM_PX, _MAD = 3.5, 0.06, 1.4826
_LEAST_COSINE = (
    0.5  # between ray and normal: beyond 60 degrees a matcher's window sees both the ball and what is behind it
)
_SEED = 20101


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """A ball: `centre` (3,) mm in the rectified frame, and its radius; `distance` is that of the centre from the left pinhole.

    `rms_px`, `rms_mm`: what its own points leave, in disparity and square to the surface.
    """

    centre: Array
    radius: Measured
    distance: Measured
    rms_mm: float
    rms_px: float
    pixels: int
    share: float


def fit_sphere(relief: Relief, patch: Patch) -> Sphere:
    """Fit the ball that a patch shows; `UsageError` where too little was matched, or nothing round is there."""
    relief.require_inside(patch)
    columns, rows, inverse, pixels = relief.pixels(patch, MOST_PIXELS)
    if len(inverse) < _FEWEST:
        raise UsageError(
            f"{len(inverse)} of the {patch.pixels} pixels of {patch} are matched, and a ball needs {_FEWEST}: choose a larger "
            "patch, or a ball with more texture"
        )
    rays = relief.rays(columns, rows)
    ball, kept = _consensus(rays, inverse, relief.scale_px, patch)
    for _ in range(_ROUNDS):
        off, J = _residuals(ball, rays, inverse, relief.scale_px)
        near = np.isfinite(off)
        agreeing = np.abs(off[kept & near])
        if len(agreeing) < _FEWEST:
            raise _no_ball(patch, len(agreeing), len(inverse))
        limit = max(_TRIM * _MAD * float(np.median(agreeing)), _LEAST_TRIM_PX)
        kept = near & (np.abs(np.where(near, off, np.inf)) <= limit)
        ball = ball + np.linalg.lstsq(J[kept], off[kept], rcond=None)[0]
    off, J = _residuals(ball, rays, inverse, relief.scale_px)
    kept &= np.isfinite(off)
    if kept.sum() < max(_FEWEST, _LEAST_SHARE * len(inverse)):
        raise _no_ball(patch, int(kept.sum()), len(inverse))
    spread = covariance(J[kept], off[kept], columns[kept], rows[kept], pixels)
    _require_round(ball, rays[kept], inverse[kept], relief.scale_px, patch)
    return _told(
        relief, ball, spread, rays[kept] * (relief.scale_px / inverse[kept])[:, None], off[kept], (pixels, kept.mean())
    )


def _require_round(ball: Array, rays: Array, inverse: Array, scale_px: float, patch: Patch) -> None:
    """Refuse a ball of which so little is seen that it might as well be flat."""
    depth = float(scale_px / np.median(inverse))
    half = depth * float(np.ptp(rays[:, :2], axis=0).max()) / 2
    radius = float(ball[3])
    bulge = radius - np.sqrt(max(radius**2 - half**2, 0.0))
    if radius <= 0 or bulge * scale_px / depth**2 < _LEAST_BULGE_PX:
        raise UsageError(
            f"no ball can be told from a flat thing in {patch}: the best one has a radius of {abs(radius):.3g} mm, choose a "
            "patch that shows more of the ball"
        )


def _no_ball(patch: Patch, found: int, pixels: int) -> UsageError:
    return UsageError(
        f"no ball has more than {found} of the {pixels} matched pixels of {patch} on it: choose a patch that is mostly ball"
    )


def _residuals(ball: Array, rays: Array, inverse: Array, scale_px: float) -> tuple[Array, Array]:
    """Return what the map has over a ball (cx, cy, cz, r), (N,) px, and the derivatives (N, 4) of the ball's disparity.

    NaN where a ray misses the ball or grazes it.
    """
    centre, radius = ball[:3], ball[3]
    square = np.sum(rays**2, axis=1)
    along = rays @ centre
    root = along**2 - square * (centre @ centre - radius**2)
    depth = (along - np.sqrt(np.maximum(root, 0.0))) / square
    normal = (depth[:, None] * rays - centre) / radius
    facing = -np.sum(normal * rays, axis=1)
    seen = (root > 0) & (depth > 0) & (facing > _LEAST_COSINE * np.sqrt(square))
    depth, facing = np.where(seen, depth, 1.0), np.where(seen, facing, 1.0)
    of_depth = np.column_stack([normal, np.ones(len(rays))]) / -facing[:, None]
    J = -(scale_px / depth**2)[:, None] * of_depth
    return np.where(seen, inverse - scale_px / depth, np.nan), J


def _consensus(rays: Array, inverse: Array, scale_px: float, patch: Patch) -> tuple[Array, NDArray[np.bool_]]:
    """Return the ball through four pixels that most pixels lie near to, and which do."""
    random = np.random.default_rng(_SEED)
    some = random.permutation(len(rays))[:_SAMPLE]
    depth = scale_px / inverse[some]
    points = rays[some] * depth[:, None]
    fours = random.integers(0, len(some), (_TRIALS, 4))
    chosen = points[fours]
    middle = chosen.mean(axis=1, keepdims=True)
    shifted = chosen - middle
    A = np.concatenate([2 * shifted, np.ones((_TRIALS, 4, 1))], axis=-1)
    sound = np.abs(np.linalg.det(A)) > 1e-6
    best, most = np.zeros(4), 0
    if sound.any():
        found = np.linalg.solve(A[sound], np.sum(shifted[sound] ** 2, axis=-1)[..., None])[..., 0]
        radius = np.sqrt(np.maximum(found[:, 3] + np.sum(found[:, :3] ** 2, axis=1), 0.0))
        for centre, size in zip(found[:, :3] + middle[sound][:, 0], radius, strict=True):
            off = np.abs(np.linalg.norm(points - centre, axis=1) - size)
            worth_px = scale_px / depth**2
            near = int(np.count_nonzero((off * worth_px < _NEAR_PX) & (points[:, 2] < centre[2])))
            if near > most:
                best, most = np.array([*centre, size]), near
    if most < max(_LEAST_SHARE * len(some), 4):
        raise _no_ball(patch, most, len(some))
    off = _residuals(best, rays, inverse, scale_px)[0]
    return best, np.abs(np.where(np.isfinite(off), off, np.inf)) < 2 * _NEAR_PX


def _told(
    relief: Relief, ball: Array, spread: Array, points: Array, off: Array, counted: tuple[int, float]
) -> Sphere:  # fmt: skip
    """Tell a ball in mm; `counted`: the matched pixels of the patch, and the share of them that lie on it."""
    centre, radius = ball[:3], float(ball[3])
    away = float(np.linalg.norm(centre))
    gradient = _gradient(relief, ball, points)
    sigmas = [None, None] if gradient is None else [
        sigma_along(relief.geometry, gradient[3]), sigma_along(relief.geometry, centre @ gradient[:3] / away)
    ]  # fmt: skip
    towards = np.append(centre / away, 0.0)
    return Sphere(
        centre=centre,
        radius=Measured.of(radius, float(np.sqrt(spread[3, 3])), sigmas[0]),
        distance=Measured.of(away, float(np.sqrt(towards @ spread @ towards)), sigmas[1]),
        rms_mm=float(np.sqrt(np.mean((np.linalg.norm(points - centre, axis=1) - radius) ** 2))),
        rms_px=float(np.sqrt(np.mean(off**2))),
        pixels=round(counted[0] * counted[1]),
        share=float(counted[1]),
    )


def _gradient(relief: Relief, ball: Array, points: Array) -> Array | None:
    """Return how centre and radius move with the calibration's numbers, (4, 24), by refitting where the points go to."""
    chosen = points[np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).astype(int)]
    moves = point_gradients(relief.geometry, chosen)
    if moves is None:
        return None
    seen = np.isfinite(moves).all(axis=(1, 2))
    chosen, moves = chosen[seen], moves[seen]
    normal = (chosen - ball[:3]) / np.linalg.norm(chosen - ball[:3], axis=1)[:, None]
    facing = np.abs(np.sum(normal * chosen, axis=1)) / chosen[:, 2]
    weight = 1 / (chosen[:, 2] ** 2 * facing)
    J = np.column_stack([normal, np.ones(len(chosen))]) * weight[:, None]
    off = np.einsum("ij,ijk->ik", normal, moves) * weight[:, None]
    return np.asarray(np.linalg.lstsq(J, off, rcond=None)[0])
