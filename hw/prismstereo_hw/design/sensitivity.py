"""How the baseline answers to each dimension of a prism rig: central differences of the exact closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from prismstereo_hw.errors import RigError
from prismstereo_hw.kinds.prism_tir import PrismRig
from prismstereo_hw.optics.unfold import fold

__all__ = ["Sensitivities", "sensitivities"]

_STEP = 1e-4


@dataclass(frozen=True, slots=True)
class Sensitivities:
    """Change of the (paraxial) baseline in mm for one more degree, millimetre or unit of index; both mirrors move alike."""

    mirror_angle_mm_per_deg: float
    near_edge_mm_per_mm: float
    offset_mm_per_mm: float
    pupil_to_prism_mm_per_mm: float
    prism_side_mm_per_mm: float
    glass_index_mm_per_unit: float
    vergence_deg_per_mirror_angle_deg: float = 4.0  # each view turns by twice the mirror's turn


def sensitivities(rig: PrismRig) -> Sensitivities:
    """Differentiate the baseline of a prism rig with respect to each of its dimensions."""
    prism, mirrors = rig.prism, rig.mirrors

    def of_prism(field: str, value: float | str) -> float:
        return _baseline_mm(msgspec.structs.replace(rig, prism=msgspec.structs.replace(prism, **{field: value})))

    def of_mirrors(field: str, value: float) -> float:
        return _baseline_mm(msgspec.structs.replace(rig, mirrors=msgspec.structs.replace(mirrors, **{field: value})))

    return Sensitivities(
        mirror_angle_mm_per_deg=_slope(lambda v: of_mirrors("angle_deg", v), mirrors.angle_deg),
        near_edge_mm_per_mm=_slope(lambda v: of_mirrors("near_edge_mm", v), mirrors.near_edge_mm),
        offset_mm_per_mm=_slope(lambda v: of_mirrors("offset_mm", v), mirrors.offset_mm),
        pupil_to_prism_mm_per_mm=_slope(lambda v: of_prism("pupil_to_prism_mm", v), prism.pupil_to_prism_mm),
        prism_side_mm_per_mm=_slope(lambda v: of_prism("side_mm", v), prism.side_mm),
        glass_index_mm_per_unit=_slope(lambda v: of_prism("glass", f"{v:.9f}"), prism.index),
    )


def _baseline_mm(rig: PrismRig) -> float:
    return -2 * float(fold(rig, "left").paraxial_centre_mm[0])


def _slope(baseline_mm: Callable[[float], float], at: float) -> float:
    """Differentiate to both sides, or to the one where parts that nearly touch still do not."""
    values = []
    for here in (at - _STEP, at, at + _STEP):
        try:
            values.append((here, baseline_mm(here)))
        except RigError:
            continue
    (begin, low), (end, high) = values[0], values[-1]
    return (high - low) / (end - begin)
