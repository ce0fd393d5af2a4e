"""How flat a flat board comes out: a plane that at least nine tenths of the points agree on, and their distances from it.

The figure of the paper's table 1 (reference: superres, section 6). Planes through three points each are tried; the one whose
90th percentile of distances is least wins, and is fitted again to the points up to there. Lengths are in the points' unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FEWEST_POINTS", "PlaneFit", "off_plane"]

Array = NDArray[np.float64]

FEWEST_POINTS = 4  # three always lie in a plane
_INLIERS = 0.9
_TRIALS = 500
_REFITS = 3
_SEED = 20101  # any fixed number: the same points must give the same plane


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """Distances of points from the plane of their board, absolute.

    `mean`, `variance` and `rms` are over ALL points, `inlier_mean` over the nine tenths that are nearest.
    """

    mean: float
    variance: float
    rms: float
    inlier_mean: float

    @classmethod
    def of(cls, boards: list[Array]) -> PlaneFit:
        """Fit a plane to the points (N, 3) of each board and put their distances together."""
        distances = [np.abs(off_plane(points)) for points in boards]
        everything = np.concatenate(distances)
        inliers = np.concatenate([np.sort(one)[: _inlier_count(len(one))] for one in distances])
        return cls(
            mean=float(everything.mean()),
            variance=float(everything.var()),
            rms=math.sqrt(float(np.mean(everything**2))),
            inlier_mean=float(inliers.mean()),
        )


def off_plane(points: Array) -> Array:
    """Return the signed distances (N,) of points (N, 3), four or more, from the plane that 90 % of them agree on."""
    random = np.random.default_rng(_SEED)
    count = _inlier_count(len(points))
    triples = points[np.argsort(random.random((_TRIALS, len(points))), axis=1)[:, :3]]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = np.where(lengths[:, None] > 0, normals / np.maximum(lengths, np.finfo(float).tiny)[:, None], np.nan)
    offsets = np.sum(normals * triples[:, 0], axis=1)
    distances = np.abs(normals @ points.T - offsets[:, None])
    scores = np.partition(distances, count - 1, axis=1)[:, count - 1]  # NaN, of three points in a line, sorts last
    off = distances[int(np.argmin(np.where(np.isfinite(scores), scores, np.inf)))]
    for _ in range(_REFITS):
        inliers = points[np.argsort(np.abs(off), kind="stable")[:count]]
        middle = inliers.mean(axis=0)
        normal = np.linalg.svd(inliers - middle, full_matrices=False)[2][2]
        off = (points - middle) @ normal
    return np.asarray(off)


def _inlier_count(points: int) -> int:
    return max(math.ceil(_INLIERS * points), 3)
