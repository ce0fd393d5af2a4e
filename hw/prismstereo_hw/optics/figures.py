"""The figures of a rig: what its optics promise, from exact rays of the middle row.

Angles are from the z axis of the scene frame (see `outlook`), positive to the right; distances are along it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError
from prismstereo_hw.optics.colour import chromatic_shift_px
from prismstereo_hw.optics.outlook import Outlook, outlook
from prismstereo_hw.optics.sight import best_common_point, sight
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

__all__ = ["DISTANCES_MM", "RigFigures", "common_strip_mm", "common_width_mm", "figures", "kept_slopes"]

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
    half_field_deg: tuple[float, float]  # left and right edge of the left view
    focal_px: float
    columns_kept: float
    seam_px: float
    chromatic_shift_px: float  # between hydrogen C and F at the near end of the range, where it is largest
    crossed: bool  # whether the left half of the frame is the right view
    mirrored: tuple[bool, bool]  # whether the left and the right view are mirror images in the raw frame
    viewpoint_residual_mm: float  # largest distance of a ray from the best common point
    viewpoint_mm: tuple[float, float]  # x and z of the left view's best common point
    overlap_from_mm: float
    overlap_to_mm: float
    common_width_mm: dict[str, float]
    depth_step_mm: dict[str, float]
    lost: dict[str, float]  # why columns are lost, and what share


def kept_slopes(rig: Rig, side: Side = "left") -> tuple[Array, dict[str, float]]:
    """Return the slopes (N, 2) of a view's middle-row pixels through which light comes, and why others are lost."""
    lens, video = rig.lens(), rig.camera.video
    x, _, w, _ = rig.views[0 if side == "left" else 1].rectangle(video.width, video.height)
    columns = np.arange(x, x + w, dtype=float)
    slopes = lens.slopes(np.stack([columns, np.full_like(columns, lens.cy_px)], axis=-1))
    traced = view_fates(rig, side, slopes)
    lost = {
        why: float(np.mean(traced.fate == index))
        for index, why in enumerate(traced.fates)
        if index and (traced.fate == index).any()
    }
    kept = slopes[traced.fate == 0]
    if len(kept) < 2:
        raise RigError(f"rig {rig.name!r} shows nothing: every column {' or '.join(lost)}")
    return kept, lost


@dataclass(frozen=True, slots=True)
class _Fan:
    """The middle row of one view in the scene frame: its common point, its field (left edge, right edge), its rays."""

    centre_mm: Array
    residual_mm: float
    field_deg: tuple[float, float]
    origin: Array
    direction: Array

    def reach(self, z_mm: float) -> tuple[float, float]:
        """Return the x of the field's edges at a distance, seen from the common point."""
        span = z_mm - self.centre_mm[2]
        low, high = (float(self.centre_mm[0]) + span * math.tan(math.radians(angle)) for angle in self.field_deg)
        return low, high

    def exact_reach(self, z_mm: float) -> tuple[float, float]:
        """Return the x of the outermost rays themselves at a distance."""
        x = self.origin[:, 0] + (z_mm - self.origin[:, 2]) / self.direction[:, 2] * self.direction[:, 0]
        return float(x.min()), float(x.max())


def _fan(rig: Rig, side: Side, looking: Outlook) -> _Fan:
    slopes, _ = kept_slopes(rig, side)
    origin, direction = sight(rig, side).rays(slopes)
    o, d = looking.to_scene(origin), direction @ looking.R_rig_from_scene
    centre, distances = best_common_point(o, d)
    angle = np.degrees(np.arctan2(d[:, 0], d[:, 2]))
    return _Fan(centre, float(distances.max()), (float(angle.min()), float(angle.max())), o, d)


def figures(rig: Rig) -> RigFigures:
    """Compute the figures of a rig; `RigError` for one that shows nothing."""
    looking = outlook(rig)
    left, right = _fan(rig, "left", looking), _fan(rig, "right", looking)
    slopes, lost = kept_slopes(rig)
    baseline = float(np.linalg.norm(right.centre_mm - left.centre_mm))
    pinholes = [sight(rig, side).centre_mm for side in ("left", "right")]
    focal_px = rig.lens().fx_px
    begin, end = _overlap(left, right)
    return RigFigures(
        rig=rig.name,
        baseline_mm=baseline,
        baseline_paraxial_mm=float(np.linalg.norm(pinholes[1] - pinholes[0])),
        vergence_deg=(sum(left.field_deg) - sum(right.field_deg)) / 2,
        half_field_deg=left.field_deg,
        focal_px=focal_px,
        columns_kept=len(slopes) / rig.views[0].rectangle(rig.camera.video.width, rig.camera.video.height)[2],
        seam_px=_seam_px(rig),
        chromatic_shift_px=chromatic_shift_px(rig, rig.range.near_mm),
        crossed=rig.views[0].left > rig.views[1].left,
        mirrored=(rig.views[0].mirrored, rig.views[1].mirrored),
        viewpoint_residual_mm=max(left.residual_mm, right.residual_mm),
        viewpoint_mm=(float(left.centre_mm[0]), float(left.centre_mm[2])),
        overlap_from_mm=begin,
        overlap_to_mm=end,
        common_width_mm={f"{z:.0f}": _common_width(left.reach(z), right.reach(z)) for z in DISTANCES_MM},
        depth_step_mm={f"{z:.0f}": z * z * _QUARTER_PIXEL / (focal_px * baseline) for z in DISTANCES_MM},
        lost=lost,
    )


def common_width_mm(rig: Rig, distance_mm: float) -> float:
    """Return how wide a strip, in the middle row at a distance, both views see; 0 where they do not overlap."""
    low, high = common_strip_mm(rig, distance_mm)
    return max(0.0, high - low)


def common_strip_mm(rig: Rig, distance_mm: float) -> tuple[float, float]:
    """Return where that strip begins and ends, x in the scene frame; begin >= end where the views do not overlap."""
    looking = outlook(rig)
    reaches = [_fan(rig, side, looking).exact_reach(distance_mm) for side in ("left", "right")]
    return max(reach[0] for reach in reaches), min(reach[1] for reach in reaches)


def _common_width(left: tuple[float, float], right: tuple[float, float]) -> float:
    return max(0.0, min(left[1], right[1]) - max(left[0], right[0]))


def _overlap(left: _Fan, right: _Fan) -> tuple[float, float]:
    """Return the distances between which at least half of the narrower view's width is common; end may be inf."""

    def enough(z: float) -> bool:
        one, other = left.reach(z), right.reach(z)
        return _common_width(one, other) >= 0.5 * min(one[1] - one[0], other[1] - other[0])

    nearest = max(1.0, float(left.centre_mm[2]) + 1, float(right.centre_mm[2]) + 1)
    grid = np.geomspace(nearest, _FAR_MM, 4000).tolist()
    good = [z for z in grid if enough(z)]
    if not good:
        return math.inf, math.inf
    step = grid[1] / grid[0]
    begin = good[0] if good[0] == grid[0] else _bisect(enough, good[0] / step, good[0])
    end = math.inf if good[-1] == grid[-1] else _bisect(lambda z: not enough(z), good[-1], good[-1] * step)
    return begin, end


def _bisect(holds: Callable[[float], bool], low: float, high: float) -> float:
    for _ in range(_SEARCH_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def _seam_px(rig: Rig) -> float:
    """Width in video columns where less than 90 % of the pupil looks through the proper mirror: the ghosted band.

    The pupil, seen from the edge that divides the views (the prism's apex, through the glass), is a disc of diameter D that
    the edge cuts at the column's own height; the share beyond the cut is a circular segment.
    """
    if rig.split_edge_mm is None:
        return 0.0
    whole = rig.lens().fx_px * rig.camera.pupil_diameter_mm / rig.split_edge_mm

    def proper(cut: float) -> bool:  # cut: 0 at the middle of the disc, 1 at its rim
        return 1 - (math.acos(cut) - cut * math.sqrt(1 - cut * cut)) / math.pi >= _PROPER_LIGHT

    return whole * _bisect(proper, 0.0, 1.0)
