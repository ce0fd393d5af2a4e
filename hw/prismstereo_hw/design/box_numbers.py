"""The numbers on the box: from where to where a rig measures with a search range, how wide it sees, how fine it steps.

Depth = focal_px * baseline_mm / (disparity_px + offset_px). The window of disparities is laid so that the far end of the
range has disparity 1 (0 stays free for unmatched) and the near end stays one below the last label: of near end, far end
and number of labels, any two give the third.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError
from prismstereo_hw.optics.figures import RigFigures, kept_slopes
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import RangeWish, Rig

__all__ = ["BoxNumbers", "box_numbers", "overlap_share", "window_for"]

LABEL_STEP = 16
MOST_LABELS = 1024
_QUARTER_PIXEL = 0.25
_RESERVE = 1.01  # the calibrated focal length and baseline of a unit differ a little from those of the drawing
_FAR_VIEW_MM = 1e7  # as good as infinity for widths
_CURVE_POINTS = 9
_CURVE_REACH = 16.0  # times the near end, where the far end is infinity


@dataclass(frozen=True, slots=True)
class BoxNumbers:
    """What a buyer reads; distances are depths from the virtual viewpoints, keyed in mm where by distance."""

    labels: int
    range_min_mm: float
    range_max_mm: float
    field_of_view_deg: tuple[
        float, float
    ]  # of the field common to both views at the middle of the range; vertical: a view's
    depth_step_mm: dict[str, float]  # of a quarter pixel, at the ends of the range and at round distances
    overlap_share: dict[str, float]  # common share of a view's width by distance


def window_for(scale_px_mm: float, near_mm: float, far_mm: float, labels: int | None = None) -> RangeWish:
    """Return the range with the labels it needs; `scale_px_mm` is focal length times baseline.

    `RigError` names the nearest possible near end where the given labels, or the most there are, do not reach.
    """
    offset_px = (scale_px_mm / far_mm if math.isfinite(far_mm) else 0.0) - 1.0
    needed = math.ceil(_RESERVE * scale_px_mm / near_mm - offset_px) + 2
    rounded = max(-(-needed // LABEL_STEP) * LABEL_STEP, LABEL_STEP)
    limit = MOST_LABELS if labels is None else labels
    if rounded > limit:
        nearest = (
            math.ceil(1.002 * _RESERVE * scale_px_mm / (limit - 2 + offset_px))
            if limit - 2 + offset_px > 0
            else math.inf
        )
        more = f" or search {rounded} labels" if rounded <= MOST_LABELS else ""
        raise RigError(
            f"a range from {near_mm:g} to {far_mm:g} mm needs {rounded} disparity labels, but {limit} are searched: "
            f"begin at {nearest:g} mm{more}"
        )
    return RangeWish(near_mm=near_mm, far_mm=far_mm, labels=rounded if labels is None else labels)


def box_numbers(rig: Rig, found: RigFigures) -> BoxNumbers:
    """Return the numbers on the box of a rig, of which the figures are known."""
    scale, wish = found.focal_px * found.baseline_mm, rig.range
    offset_px = (scale / wish.far_mm if math.isfinite(wish.far_mm) else 0.0) - 1.0
    begin = scale / (wish.labels - 2 + offset_px)
    reach = wish.far_mm if math.isfinite(wish.far_mm) else _CURVE_REACH * wish.near_mm
    curve = np.geomspace(wish.near_mm, reach, _CURVE_POINTS).tolist()
    middle = 2 / (1 / wish.near_mm + 1 / wish.far_mm)
    width = overlap_share(rig, middle)[1]
    steps = sorted({z for z in (wish.near_mm, wish.far_mm, 500.0, 1000.0, 2000.0) if math.isfinite(z)})
    return BoxNumbers(
        labels=wish.labels,
        range_min_mm=begin,
        range_max_mm=wish.far_mm,
        field_of_view_deg=(
            2 * math.degrees(math.atan(width / 2 / middle)),
            2 * math.degrees(math.atan(rig.camera.video.height / 2 / found.focal_px)),
        ),
        depth_step_mm={f"{z:.0f}": z * z * _QUARTER_PIXEL / scale for z in steps},
        overlap_share={f"{z:.0f}": overlap_share(rig, z)[0] for z in curve} | {"inf": overlap_share(rig, math.inf)[0]},
    )


def overlap_share(rig: Rig, depth_mm: float) -> tuple[float, float]:
    """Return which share of a view's width in the middle row both views see at a depth, and that width in mm.

    Depth counts from the virtual viewpoints, as in every depth map. At infinity the width is that at ten kilometres.
    """
    slopes, _ = kept_slopes(rig)
    view = fold(rig, "left")
    origin, direction = view.rays(slopes)
    z = min(depth_mm, _FAR_VIEW_MM) + float(view.paraxial_centre_mm[2])
    x: NDArray[np.float64] = origin[:, 0] + (z - origin[:, 2]) / direction[:, 2] * direction[:, 0]
    outer, inner = float(x.min()), float(x.max())
    common = max(0.0, 2 * min(inner, -outer))
    return min(1.0, common / (inner - outer)), common
