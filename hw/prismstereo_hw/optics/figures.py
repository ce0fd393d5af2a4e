"""The figures of a rig: what its optics promise, from exact rays of the middle row.

Angles are from the rig's z axis, positive towards the axis of symmetry; distances are from the entrance pupil.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig

__all__ = ["DISTANCES_MM", "RigFigures", "common_width_mm", "figures", "kept_slopes"]

Array = NDArray[np.float64]
DISTANCES_MM = (500.0, 1000.0, 2000.0)
_QUARTER_PIXEL = 0.25
_PROPER_LIGHT = 0.9  # a column belongs to its view when this share of the pupil looks through the right mirror
_FAR_MM = 1e7
_SEARCH_STEPS = 60


@dataclass(frozen=True, slots=True)
class RigFigures:
    """What one rig gives; every key carries its unit."""

    rig: str
    baseline_mm: float  # between the best common points of each view's rays
    baseline_paraxial_mm: float
    vergence_deg: float  # between the middles of the two views' fields
    half_field_deg: tuple[float, float]
    focal_px: float
    columns_kept: float
    seam_px: float
    viewpoint_residual_mm: float  # largest distance of a ray from the best common point
    viewpoint_mm: tuple[float, float]  # x and z of the left view's best common point
    overlap_from_mm: float
    overlap_to_mm: float
    common_width_mm: dict[str, float]
    depth_step_mm: dict[str, float]
    lost: dict[str, float]  # why columns are lost, and what share


def kept_slopes(rig: Rig) -> tuple[Array, dict[str, float]]:
    """Return the slopes (N, 2) of the left view's middle-row pixels through which light comes, and why others are lost."""
    lens, video = rig.lens(), rig.camera.video
    x, _, w, _ = rig.views[0].rectangle(video.width, video.height)
    columns = np.arange(x, x + w, dtype=float)
    slopes = lens.slopes(np.stack([columns, np.full_like(columns, lens.cy_px)], axis=-1))
    traced = view_fates(rig, "left", slopes)
    lost = {
        why: float(np.mean(traced.fate == index))
        for index, why in enumerate(traced.fates)
        if index and (traced.fate == index).any()
    }
    kept = slopes[(traced.fate == 0) & (slopes[:, 0] > 0)]
    if len(kept) < 2:
        raise RigError(f"rig {rig.name!r} shows nothing: every column {' or '.join(lost)}")
    return kept, lost


def figures(rig: Rig) -> RigFigures:
    """Compute the figures of a rig; `RigError` for one that shows nothing."""
    slopes, lost = kept_slopes(rig)
    view = fold(rig, "left")
    origin, direction = view.rays(slopes)
    centre, residual = _best_common_point(origin, direction)
    angle = np.degrees(np.arctan2(direction[:, 0], direction[:, 2]))
    field = float(angle.min()), float(angle.max())
    baseline = -2 * centre[0]
    focal_px = rig.lens().fx_px
    begin, end = _overlap(centre, field)
    return RigFigures(
        rig=rig.name,
        baseline_mm=baseline,
        baseline_paraxial_mm=float(-2 * view.paraxial_centre_mm[0]),
        vergence_deg=field[0] + field[1],
        half_field_deg=field,
        focal_px=focal_px,
        columns_kept=len(slopes) / rig.views[0].rectangle(rig.camera.video.width, rig.camera.video.height)[2],
        seam_px=_seam_px(rig),
        viewpoint_residual_mm=residual,
        viewpoint_mm=(centre[0], centre[1]),
        overlap_from_mm=begin,
        overlap_to_mm=end,
        common_width_mm={f"{z:.0f}": _common_width(centre, field, z) for z in DISTANCES_MM},
        depth_step_mm={f"{z:.0f}": z * z * _QUARTER_PIXEL / (focal_px * baseline) for z in DISTANCES_MM},
        lost=lost,
    )


def common_width_mm(rig: Rig, distance_mm: float) -> float:
    """Return how wide a strip, in the middle row at a distance, both views see; 0 where they do not overlap."""
    slopes, _ = kept_slopes(rig)
    origin, direction = fold(rig, "left").rays(slopes)
    x = origin[:, 0] + (distance_mm - origin[:, 2]) / direction[:, 2] * direction[:, 0]
    return max(0.0, 2 * float(min(x.max(), -x.min())))


def _best_common_point(origin: Array, direction: Array) -> tuple[tuple[float, float], float]:
    """Return x, z of the point nearest to all rays of the middle row (least squares), and the farthest ray's distance."""
    o, d = origin[:, [0, 2]], direction[:, [0, 2]]
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    projectors = np.eye(2) - d[:, :, None] * d[:, None, :]
    point = np.linalg.solve(projectors.sum(axis=0), np.einsum("nij,nj->i", projectors, o))
    residual = np.linalg.norm(np.einsum("nij,nj->ni", projectors, point - o), axis=1)
    return (float(point[0]), float(point[1])), float(residual.max())


def _reach(centre: tuple[float, float], field: tuple[float, float], z_mm: float) -> tuple[float, float]:
    """Return the left view's borders at a distance: x of its outer and its inner edge."""
    span = z_mm - centre[1]
    return centre[0] + span * math.tan(math.radians(field[0])), centre[0] + span * math.tan(math.radians(field[1]))


def _common_width(centre: tuple[float, float], field: tuple[float, float], z_mm: float) -> float:
    outer, inner = _reach(centre, field, z_mm)
    return max(0.0, 2 * min(inner, -outer))


def _overlap(centre: tuple[float, float], field: tuple[float, float]) -> tuple[float, float]:
    """Return the distances between which at least half of a view's width is common; end may be inf."""

    def enough(z: float) -> bool:
        outer, inner = _reach(centre, field, z)
        return _common_width(centre, field, z) >= 0.5 * (inner - outer)

    grid = np.geomspace(1.0, _FAR_MM, 4000).tolist()
    good = [z for z in grid if enough(z)]
    if not good:
        return math.inf, math.inf
    begin = _bisect(enough, good[0] / (grid[1] / grid[0]), good[0])
    end = math.inf if good[-1] == grid[-1] else _bisect(lambda z: not enough(z), good[-1], good[-1] * grid[1] / grid[0])
    return begin, end


def _bisect(holds: Callable[[float], bool], low: float, high: float) -> float:
    for _ in range(_SEARCH_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def _seam_px(rig: Rig) -> float:
    """Width in video columns where less than 90 % of the pupil looks through the proper mirror: the ghosted band.

    The pupil, seen from the prism's apex through the glass, is a disc of diameter D that the apex cuts at the column's
    own height; the share beyond the cut is a circular segment.
    """
    prism, lens = rig.prism, rig.lens()
    whole = lens.fx_px * rig.camera.pupil_diameter_mm / (prism.pupil_to_prism_mm + prism.height_mm / prism.index)

    def proper(cut: float) -> bool:  # cut: 0 at the middle of the disc, 1 at its rim
        return 1 - (math.acos(cut) - cut * math.sqrt(1 - cut * cut)) / math.pi >= _PROPER_LIGHT

    return whole * _bisect(proper, 0.0, 1.0)
