"""What assembly does to a prism rig: units built with errors, before calibration, after it, and after something crept.

Each unit draws its prism and, one by one, its mirrors. A point of known place is then looked at through the unit's exact
optics and triangulated three times: with the drawing's numbers; with the unit's own, as a one-lens calibration finds them
(any pose is absorbed, so only what a pinhole cannot follow is left); and with these after one mirror has turned a little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.design.pinhole import PinholeView, fit_pinhole
from prismstereo_hw.errors import RigError
from prismstereo_hw.kinds.prism_tir import Mirrors, Prism, PrismRig
from prismstereo_hw.optics.figures import kept_slopes
from prismstereo_hw.optics.unfold import FoldedView, fold

__all__ = ["ABSORBED", "REMAINING", "ToleranceReport", "Tolerances", "assembly"]

Array = NDArray[np.float64]
Views = tuple[FoldedView, FoldedView]
Pinholes = tuple[PinholeView, PinholeView]

ABSORBED = (
    "place and angle of each mirror, tips included: they are part of the free pose",
    "distance of the prism, its size and its index: they shift the viewpoints and scale the focal length",
)
REMAINING = (
    "what of the glass no pinhole can follow, where a unit is calibrated without its glass",
    "columns that a displaced mirror or prism cuts off",
    "anything that moves after calibration",
)
_ROUND_DISTANCES_MM = (500.0, 1000.0, 2000.0)
_FAR_ENOUGH = 20.0  # times the near end, where the range is infinite
_ASIDE = (-0.3, 0.0, 0.3)  # of the common width: where the points stand


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Standard deviations of a unit's dimensions from the drawing, and how far one mirror turns after calibration.

    The defaults are those of a printed or laser-cut mount and catalogue optics.
    """

    mirror_angle_deg: float = 0.3
    mirror_position_mm: float = 0.3
    mirror_tip_deg: float = 0.3
    prism_side_mm: float = 0.1
    pupil_to_prism_mm: float = 1.0
    glass_index: float = 0.0005
    creep_deg: float = 0.01


@dataclass(frozen=True, slots=True)
class ToleranceReport:
    """What remains of the errors of assembly.

    Depth errors are medians over units and points of the absolute error in mm, keyed by distance in mm: with the
    drawing's numbers some far points come out behind the sensor, which a mean would not survive.
    """

    seed: int
    units: int  # that could be built
    unbuildable: int  # whose mirrors would have touched the prism
    baseline_spread_mm: float
    vergence_spread_deg: float
    rows_apart_px: float  # rms, of a point in both views with the drawing's numbers
    columns_kept_least: float  # of all units
    creep_deg: float
    error_from_drawing_mm: dict[str, float]
    error_calibrated_mm: dict[str, float]
    error_after_creep_mm: dict[str, float]
    absorbed: tuple[str, ...] = ABSORBED
    remaining: tuple[str, ...] = REMAINING


@dataclass(frozen=True, slots=True)
class _Unit:
    baseline_mm: float
    vergence_deg: float
    kept: float
    rows_px: float
    errors_mm: Array  # (3, distances, points): from the drawing, calibrated, after creep


def assembly(rig: PrismRig, tolerances: Tolerances | None = None, units: int = 60, seed: int = 2010) -> ToleranceReport:
    """Build units of a rig with random errors and report what they cost; the same seed draws the same units."""
    tolerances = Tolerances() if tolerances is None else tolerances
    rng = np.random.default_rng(seed)
    bench = _Bench.of(rig)
    built = [bench.unit(rng, tolerances) for _ in range(units)]
    made = [unit for unit in built if unit is not None]
    if not made:
        raise RigError(
            f"none of {units} units of rig {rig.name!r} could be built: its mirrors stand too near to the prism for "
            f"positions good to {tolerances.mirror_position_mm:g} mm"
        )
    typical = np.median(np.abs([unit.errors_mm for unit in made]), axis=(0, 3))
    distances = bench.points[:, 0, 2]
    by_distance = [{f"{z:.0f}": float(mm) for z, mm in zip(distances, row, strict=True)} for row in typical]
    return ToleranceReport(
        seed=seed,
        units=len(made),
        unbuildable=units - len(made),
        baseline_spread_mm=float(np.std([unit.baseline_mm for unit in made])),
        vergence_spread_deg=float(np.std([unit.vergence_deg for unit in made])),
        rows_apart_px=float(np.sqrt(np.mean([unit.rows_px**2 for unit in made]))),
        columns_kept_least=min(unit.kept for unit in made),
        creep_deg=tolerances.creep_deg,
        error_from_drawing_mm=by_distance[0],
        error_calibrated_mm=by_distance[1],
        error_after_creep_mm=by_distance[2],
    )


@dataclass(frozen=True, slots=True)
class _Bench:
    """The drawing, its pinholes, and the points (distances, points, 3) that every unit looks at."""

    rig: PrismRig
    pinholes: Pinholes
    points: Array

    @classmethod
    def of(cls, rig: PrismRig) -> _Bench:
        views = fold(rig, "left"), fold(rig, "right")
        slopes, _ = kept_slopes(rig)
        origin, direction = views[0].rays(slopes)
        points = []
        for z in _distances_mm(rig):
            x = origin[:, 0] + (z - origin[:, 2]) / direction[:, 2] * direction[:, 0]
            half_width = max(0.0, min(float(x.max()), -float(x.min())))
            points.append([(2 * aside * half_width, 0.05 * z, z) for aside in _ASIDE])
        return cls(rig, _calibrated(rig, views), np.array(points))

    def unit(self, rng: np.random.Generator, tolerances: Tolerances) -> _Unit | None:
        """Draw one unit and measure it; None where its parts would collide."""
        prism = _drawn_prism(self.rig.prism, rng, tolerances)
        mirrors = [_drawn_mirrors(self.rig.mirrors, rng, tolerances) for _ in range(2)]
        try:
            halves = [msgspec.structs.replace(self.rig, prism=prism, mirrors=pair) for pair in mirrors]
            crept = _turned(halves[0], tolerances.creep_deg)
            kept = [len(kept_slopes(half)[0]) for half in halves]
        except RigError:
            return None
        views = fold(halves[0], "left"), fold(halves[1], "right")
        own = _calibrated(self.rig, views)
        seen = _looked_at(views, self.points)
        seen_crept = _looked_at((fold(crept, "left"), views[1]), self.points)
        errors = [_depths(self.pinholes, seen), _depths(own, seen), _depths(own, seen_crept)]
        columns = self.rig.views[0].rectangle(self.rig.camera.video.width, self.rig.camera.video.height)[2]
        return _Unit(
            baseline_mm=float(np.linalg.norm(own[0].centre_mm - own[1].centre_mm)),
            vergence_deg=2 * (mirrors[0].angle_deg + mirrors[1].angle_deg),  # up to a constant
            kept=min(kept) / columns,
            rows_px=_rows_apart(self.pinholes, seen) * self.rig.lens().fx_px,
            errors_mm=np.array(errors) - self.points[..., 2],
        )


def _distances_mm(rig: PrismRig) -> list[float]:
    near, far = rig.range.near_mm, rig.range.far_mm
    inside = {z for z in _ROUND_DISTANCES_MM if near < z < far}
    return sorted(inside | {near, far if math.isfinite(far) else max(4 * near, *_ROUND_DISTANCES_MM)})


def _drawn_prism(prism: Prism, rng: np.random.Generator, tolerances: Tolerances) -> Prism:
    return msgspec.structs.replace(
        prism,
        side_mm=rng.normal(prism.side_mm, tolerances.prism_side_mm),
        pupil_to_prism_mm=rng.normal(prism.pupil_to_prism_mm, tolerances.pupil_to_prism_mm),
        glass=f"{rng.normal(prism.index, tolerances.glass_index):.9f}",
    )


def _drawn_mirrors(mirrors: Mirrors, rng: np.random.Generator, tolerances: Tolerances) -> Mirrors:
    tip = rng.normal(0.0, tolerances.mirror_tip_deg, 2)
    return msgspec.structs.replace(
        mirrors,
        angle_deg=rng.normal(mirrors.angle_deg, tolerances.mirror_angle_deg),
        near_edge_mm=rng.normal(mirrors.near_edge_mm, tolerances.mirror_position_mm),
        offset_mm=rng.normal(mirrors.offset_mm, tolerances.mirror_position_mm),
        left_tip_deg=mirrors.left_tip_deg + float(tip[0]),
        right_tip_deg=mirrors.right_tip_deg + float(tip[1]),
    )


def _turned(rig: PrismRig, angle_deg: float) -> PrismRig:
    mirrors = msgspec.structs.replace(rig.mirrors, angle_deg=rig.mirrors.angle_deg + angle_deg)
    return msgspec.structs.replace(rig, mirrors=mirrors)


def _calibrated(rig: PrismRig, views: Views) -> Pinholes:
    """Return what calibrating these views over the rig's range gives at best."""
    far_mm = min(rig.range.far_mm, _FAR_ENOUGH * rig.range.near_mm)
    widest = math.tan(math.radians(rig.camera.hfov_deg / 2))
    left, right = (fit_pinhole(view, widest, rig.range.near_mm, far_mm) for view in views)
    return left, right


def _looked_at(views: Views, points: Array) -> tuple[Array, Array]:
    flat = points.reshape(-1, 3)
    return views[0].slopes(flat), views[1].slopes(flat)


def _rays(pinholes: Pinholes, seen: tuple[Array, Array]) -> tuple[Array, Array]:
    return pinholes[0].directions(seen[0]), pinholes[1].directions(seen[1])


def _rows_apart(pinholes: Pinholes, seen: tuple[Array, Array]) -> float:
    """Return the rms difference of the two rays' slopes along y, in the rig frame."""
    a, b = _rays(pinholes, seen)
    return float(np.sqrt(np.mean((a[:, 1] / a[:, 2] - b[:, 1] / b[:, 2]) ** 2)))


def _depths(pinholes: Pinholes, seen: tuple[Array, Array]) -> Array:
    """Return z in mm of the points nearest to both rays, (distances, points)."""
    a, b = _rays(pinholes, seen)
    apart = pinholes[1].centre_mm - pinholes[0].centre_mm
    aa, bb, ab = (np.einsum("ni,ni->n", u, v) for u, v in ((a, a), (b, b), (a, b)))
    ad, bd = a @ apart, b @ apart
    spread = aa * bb - ab * ab
    on_a = pinholes[0].centre_mm + ((ad * bb - bd * ab) / spread)[:, None] * a
    on_b = pinholes[1].centre_mm + ((ad * ab - bd * aa) / spread)[:, None] * b
    return np.asarray((on_a + on_b)[:, 2] / 2).reshape(-1, len(_ASIDE))
