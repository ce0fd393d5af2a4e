"""What a prism rig cannot give, said honestly: each limit with its number and, where there is one, its mend."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from prismstereo_hw.design.box_numbers import overlap_share
from prismstereo_hw.kinds.prism_tir import PrismRig
from prismstereo_hw.optics.figures import RigFigures
from prismstereo_hw.optics.trace import view_fates

__all__ = ["Limit", "limits", "widest_field_deg"]

Kind = Literal["total_reflection", "vignetting", "seam", "overlap", "viewpoint", "still"]
_ENOUGH_OVERLAP = 0.8
_RESIDUAL_PX = 0.5  # of disparity at the near end: above, a glass term in the calibration pays
_LEAST_INDEX = 1.3
_STILL_GRID = (41, 31)


@dataclass(frozen=True, slots=True)
class Limit:
    """One thing that cannot be had: its kind, its number (`value` in `unit`), and a sentence."""

    kind: Kind
    value: float
    unit: Literal["share", "px"]
    says: str


def widest_field_deg(index: float) -> float:
    """Return the widest field of view that an equilateral prism of a glass reflects totally: 0 for hardly any glass.

    >>> round(widest_field_deg(1.5168), 1)
    58.4
    """
    inside = index * math.sin(math.radians(60) - math.asin(1 / index))
    return 2 * math.degrees(math.asin(min(1.0, max(0.0, inside))))


def limits(rig: PrismRig, found: RigFigures) -> tuple[Limit, ...]:
    """List what a rig, of which the figures are known, cannot give."""
    return (*_dark_columns(rig, found), _seam(rig, found), *_overlap(rig), *_viewpoint(rig, found), *_still(rig))


def _dark_columns(rig: PrismRig, found: RigFigures) -> tuple[Limit, ...]:
    said = []
    for why, share in found.lost.items():
        if "totally reflected" in why:
            said.append(_total_reflection(rig, share))
        elif "misses the reflecting face" in why:  # only rays from beyond the seam do
            sentence = (
                f"{100 * share:.1f} % of a view's columns show the other view: the optical axis is off the middle"
            )
            said.append(Limit("seam", share, "share", sentence))
        else:
            sentence = f"{100 * share:.1f} % of a view's columns are dark: a ray {why}; lengthen that part or move it"
            said.append(Limit("vignetting", share, "share", sentence))
    return tuple(said)


def _total_reflection(rig: PrismRig, share: float) -> Limit:
    field = rig.camera.hfov_deg
    needed = next(n for n in np.arange(_LEAST_INDEX, 3.0, 0.01).tolist() if widest_field_deg(n) >= field or n > 2.98)
    return Limit(
        "total_reflection",
        share,
        "share",
        f"{100 * share:.1f} % of a view's columns are dark: {rig.prism.glass} (index {rig.prism.index:.3f}) reflects "
        f"totally up to a field of {widest_field_deg(rig.prism.index):.1f} degrees, the camera sees {field:g}; "
        f"a glass of index {needed:.2f} keeps all",
    )


def _seam(rig: PrismRig, found: RigFigures) -> Limit:
    share = found.seam_px / rig.camera.video.width
    return Limit(
        "seam",
        found.seam_px,
        "px",
        f"{found.seam_px:.0f} columns in the middle ({100 * share:.1f} % of the frame) show both views at once: "
        "a smaller aperture narrows this band in proportion",
    )


def _overlap(rig: PrismRig) -> tuple[Limit, ...]:
    said = []
    for z in (rig.range.near_mm, rig.range.far_mm):
        share, _ = overlap_share(rig, z)
        if share < _ENOUGH_OVERLAP:
            where = f"at {z:.0f} mm" if math.isfinite(z) else "at infinity"
            sentence = f"{where} {100 * share:.0f} % of a view's width is common to both: only there depth is measured"
            said.append(Limit("overlap", share, "share", sentence))
    return tuple(said)


def _viewpoint(rig: PrismRig, found: RigFigures) -> tuple[Limit, ...]:
    pixels = found.focal_px * found.viewpoint_residual_mm / rig.range.near_mm
    if pixels < _RESIDUAL_PX:
        return ()
    sentence = (
        f"the glass spreads each viewpoint over {found.viewpoint_residual_mm:.2f} mm, {pixels:.1f} px at the near end: "
        "calibrate with the glass term, or take a smaller prism"
    )
    return (Limit("viewpoint", pixels, "px", sentence),)


def _still(rig: PrismRig) -> tuple[Limit, ...]:
    """Tell which share of the taller still the parts cut off; the video is the reference."""
    lens, still = rig.lens(rig.camera.still), rig.camera.still
    x, y, w, h = rig.views[0].rectangle(still.width, still.height)
    columns, rows = np.meshgrid(np.linspace(x, x + w - 1, _STILL_GRID[0]), np.linspace(y, y + h - 1, _STILL_GRID[1]))
    through = view_fates(rig, "left", lens.slopes(np.stack([columns, rows], axis=-1))).fate == 0
    middle = through[_STILL_GRID[1] // 2]
    if not middle.any():
        return ()
    lost = 1 - float(through[:, middle].mean())
    if lost < 0.005:
        return ()
    sentence = (
        f"{100 * lost:.0f} % of a view in the taller still is cut off above and below: higher mirrors or a longer prism "
        "show it; the video is whole"
    )
    return (Limit("still", lost, "share", sentence),)
