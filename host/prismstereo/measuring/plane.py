"""The plane in a patch of a relief, fitted where its noise is even: in disparity, of which a plane is a linear function.

A point X on the plane n X = h is seen along the ray r with z one at disparity + offset = q r, q = scale n / h. Three numbers,
one linear fit, no bias towards the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.measuring.calibration_share import MOST_POINTS, point_gradients, sigma_along
from prismstereo.measuring.clustered import MOST_PIXELS, covariance
from prismstereo.measuring.measured import Measured
from prismstereo.measuring.patch import Patch
from prismstereo.measuring.relief import Relief
from prismstereo_hw.errors import UsageError

__all__ = ["FEWEST_PIXELS", "Plane", "fit_plane"]

Array = NDArray[np.float64]

FEWEST_PIXELS = 30
_TRIALS, _SAMPLE = 300, 3000
_NEAR_PX = 0.3  # of a plane through three pixels: its own, noise of all four included
_LEAST_SHARE = 0.25
_ROUNDS = 5
_TRIM, _LEAST_TRIM_PX, _MAD = 3.5, 0.06, 1.4826
_SEED = 20101  # any fixed number: the same map must give the same plane


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane n X = h in the rectified frame: unit `normal` (3,) away from the camera, `distance` h from the left pinhole.

    `tilt_deg`: between its normal and the optical axis. `rms_mm`, `rms_px`: what its own points leave, along the normal and in
    disparity. `share`: of the matched pixels of the patch, those that belong to it. `q`, its `q_covariance` (3, 3) and
    `gradient` (4, 24), of the normal and of h by the calibration's numbers, serve what is measured against it.
    """

    normal: Array
    distance: Measured
    tilt_deg: float
    tilt_sigma_deg: float
    rms_mm: float
    rms_px: float
    pixels: int
    share: float
    q: Array
    q_covariance: Array
    gradient: Array | None


def fit_plane(relief: Relief, patch: Patch) -> Plane:
    """Fit the plane that most of a patch lies on; `UsageError` where too little was matched, or nothing is flat."""
    relief.require_inside(patch)
    columns, rows, inverse, pixels = relief.pixels(patch, MOST_PIXELS)
    if len(inverse) < FEWEST_PIXELS:
        raise UsageError(
            f"{len(inverse)} of the {patch.pixels} pixels of {patch} are matched, and a plane needs {FEWEST_PIXELS}: "
            "choose a larger or better textured patch"
        )
    J = relief.rays(columns, rows)
    kept = _consensus(J, inverse, patch)
    for _ in range(_ROUNDS):
        q = np.asarray(np.linalg.lstsq(J[kept], inverse[kept], rcond=None)[0], np.float64)
        off = np.abs(inverse - J @ q)
        kept = off <= max(_TRIM * _MAD * float(np.median(off[kept])), _LEAST_TRIM_PX)
    q = np.asarray(np.linalg.lstsq(J[kept], inverse[kept], rcond=None)[0], np.float64)
    residuals = np.asarray(inverse[kept] - J[kept] @ q, np.float64)
    spread = covariance(J[kept], residuals, columns[kept], rows[kept], pixels)
    return _told(relief, q, spread, J[kept], inverse[kept], (pixels, float(kept.mean())))


def _consensus(J: Array, inverse: Array, patch: Patch) -> NDArray[np.bool_]:
    """Tell which pixels (N,) lie near the plane through three of them that most lie near to."""
    random = np.random.default_rng(_SEED)
    some = random.permutation(len(J))[:_SAMPLE]
    triples = some[random.integers(0, len(some), (_TRIALS, 3))]
    corners = J[triples]
    sound = np.abs(np.linalg.det(corners)) > 1e-9 * np.abs(np.ptp(J[:, :2], axis=0)).max() ** 2
    best, most = np.zeros(len(J), bool), 0
    if sound.any():
        planes = np.linalg.solve(corners[sound], inverse[triples[sound]][..., None])[..., 0]
        near = (np.abs(inverse[some, None] - J[some] @ planes.T) < _NEAR_PX).sum(axis=0)
        most = int(near.max())
        best = np.abs(inverse - J @ planes[int(np.argmax(near))]) < _NEAR_PX
    if most < max(_LEAST_SHARE * len(some), 3):
        raise UsageError(
            f"no plane has more than {100 * most / len(some):.0f} % of the matched pixels of {patch} within {_NEAR_PX} px: "
            "choose a patch of one flat thing"
        )
    return best


def _told(relief: Relief, q: Array, spread: Array, J: Array, inverse: Array, counted: tuple[int, float]) -> Plane:
    """Tell a plane in mm; `counted`: the matched pixels of the patch, and the share of them that lie on it."""
    scale, length = relief.scale_px, float(np.linalg.norm(q))
    normal, distance_mm = q / length, scale / length
    of_distance = -distance_mm * q / length**2
    tangent = np.array([normal[0], normal[1], 0.0])
    slope = float(np.linalg.norm(tangent))
    tilt = math.atan2(slope, float(normal[2]))
    of_tilt = np.zeros(3)
    if slope > 0:
        direction = np.array([normal[2] * normal[0] / slope, normal[2] * normal[1] / slope, -slope])
        of_tilt = direction / length
    points = J * (scale / inverse)[:, None]
    residuals = inverse - J @ q
    gradient = _gradient(relief, normal, points)
    matching = float(np.sqrt(of_distance @ spread @ of_distance))
    calibration = None if gradient is None else sigma_along(relief.geometry, gradient[3])
    return Plane(
        normal=normal,
        distance=Measured.of(distance_mm, matching, calibration),
        tilt_deg=math.degrees(tilt),
        tilt_sigma_deg=math.degrees(float(np.sqrt(of_tilt @ spread @ of_tilt))),
        rms_mm=float(np.sqrt(np.mean((points @ normal - distance_mm) ** 2))),
        rms_px=float(np.sqrt(np.mean(residuals**2))),
        pixels=round(counted[0] * counted[1]),
        share=counted[1],
        q=q,
        q_covariance=spread,
        gradient=gradient,
    )


def _gradient(relief: Relief, normal: Array, points: Array) -> Array | None:
    """Return how normal and distance move with the calibration's numbers, (4, 24), by refitting where its points go to."""
    chosen = points[np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).astype(int)]
    moves = point_gradients(relief.geometry, chosen)
    if moves is None:
        return None
    seen = np.isfinite(moves).all(axis=(1, 2))
    chosen, moves = chosen[seen], moves[seen]
    first = np.cross(normal, [0.0, 1.0, 0.0] if abs(normal[1]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    weight = 1 / chosen[:, 2] ** 2
    J = np.column_stack([chosen @ first, chosen @ second, np.full(len(chosen), -1.0)]) * weight[:, None]
    off = -np.einsum("j,ijk->ik", normal, moves) * weight[:, None]
    a, b, of_distance = np.linalg.lstsq(J, off, rcond=None)[0]
    return np.vstack([np.outer(first, a) + np.outer(second, b), of_distance])
