"""From a wish to a rig: camera, baseline and range in; prism, mirrors and an honest account of them out.

The choices, in their order:
1. Mirror angle. Turning the mirrors trades the common field near against that far. Both views converge no more than gives
   80 % of common width at the near end, and never past equal shares at both ends; so a narrow lens with a range from 0.4 m
   to infinity converges at 0.8 m, and a wide one looks nearly parallel.
2. Place and length of the mirrors: follow in closed form (`placement`), for each stock prism that admits the field.
3. Prism: the smallest whose usable columns, kept and not ghosted at the seam, come within 3 % of the best one's. A larger
   prism narrows the seam, but spreads the viewpoints and enlarges everything.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import msgspec

from prismstereo_hw.design.box_numbers import MOST_LABELS, BoxNumbers, box_numbers, overlap_share, window_for
from prismstereo_hw.design.limits import Limit, limits
from prismstereo_hw.design.placement import ExitRays, exit_rays, high_enough, parallel_angle_deg, place, probe
from prismstereo_hw.design.sensitivity import Sensitivities, sensitivities
from prismstereo_hw.design.tolerance import ToleranceReport, assembly
from prismstereo_hw.errors import RigError
from prismstereo_hw.glass import refractive_index
from prismstereo_hw.kinds.prism_tir import Prism, PrismRig
from prismstereo_hw.optics.figures import RigFigures, figures
from prismstereo_hw.rig import Camera, RangeWish

__all__ = ["PRISM_SIDES_MM", "Design", "baseline_reach_mm", "design", "examine"]

PRISM_SIDES_MM = (12.7, 15.0, 20.0, 25.4, 30.0, 40.0, 50.8)  # stock equilateral prisms
_NEAR_SHARE = 0.8
_LEAST_SHARE = 0.1  # of a view's width, at both ends of the range
_MENDED_SHARE = 0.25
_USABLE_SLACK = 0.03
_ANGLE_STEP_DEG = 0.05
_SMALLEST_BASELINE_MM = 5.0
_LARGEST_BASELINE_MM = 2000.0
_SCAN_RATIO = 1.03
_SCAN_RAYS = 24
_HALVINGS = 12


@dataclass(frozen=True, slots=True)
class Design:
    """A rig and everything that is to be known before it is built."""

    rig: PrismRig
    figures: RigFigures
    limits: tuple[Limit, ...]
    sensitivities: Sensitivities
    box: BoxNumbers
    assembly: ToleranceReport


@dataclass(frozen=True, slots=True)
class _Wish:
    camera: Camera
    baseline_mm: float
    near_mm: float
    far_mm: float
    glass: str
    pupil_to_prism_mm: float

    def prism(self, side_mm: float) -> Prism:
        return Prism(side_mm=side_mm, length_mm=1000.0, glass=self.glass, pupil_to_prism_mm=self.pupil_to_prism_mm)


def design(
    camera: Camera,
    baseline_mm: float,
    near_mm: float,
    far_mm: float,
    labels: int | None = None,
    glass: str = "N-BK7",
    *,
    pupil_to_prism_mm: float,
    name: str = "my-rig",
) -> Design:
    """Design a rig for a camera, a baseline and a range (far may be inf); labels default to what the range needs.

    `pupil_to_prism_mm` is how near the prism can come to the entrance pupil. `RigError` for a wish that cannot be had
    names the nearest one that can.
    """
    if not math.isfinite(baseline_mm):
        raise RigError(f"baseline {baseline_mm} mm: give a number of millimetres")
    refractive_index(glass)  # refuses a name that no glass has
    range_wish = RangeWish(near_mm=near_mm, far_mm=far_mm, labels=MOST_LABELS if labels is None else labels)
    wish = _Wish(camera, baseline_mm, near_mm, far_mm, glass, pupil_to_prism_mm)
    benches = _benches(wish, range_wish)
    rigs = [(rig, rays) for side, rays in benches if (rig := _built(wish, range_wish, side, rays, name)) is not None]
    if not rigs:
        raise RigError(_baseline_complaint(wish, benches))
    rig = _chosen(rigs)
    found = figures(rig)
    _require_overlap(rig, found)
    window = window_for(found.focal_px * found.baseline_mm, near_mm, far_mm, labels)
    return _examined(high_enough(msgspec.structs.replace(rig, range=window)), found)


def examine(rig: PrismRig) -> Design:
    """Say of a prism rig what `design` says of its own."""
    return _examined(rig, figures(rig))


def _examined(rig: PrismRig, found: RigFigures) -> Design:
    return Design(rig, found, limits(rig, found), sensitivities(rig), box_numbers(rig, found), assembly(rig))


def baseline_reach_mm(
    camera: Camera, near_mm: float, far_mm: float, glass: str = "N-BK7", *, pupil_to_prism_mm: float
) -> tuple[float, float]:
    """Return the smallest and the largest baseline that a camera can have with stock parts and no ray lost to them."""
    wish = _Wish(camera, 0.0, near_mm, far_mm, glass, pupil_to_prism_mm)
    benches = _benches(wish, RangeWish(near_mm=near_mm, far_mm=far_mm, labels=MOST_LABELS))
    spans = [span for bench in benches for span in _spans(wish, *bench)]
    if not spans:
        raise RigError(_no_mirrors(wish))
    return min(low for low, _ in spans), max(high for _, high in spans)


def _benches(wish: _Wish, range_wish: RangeWish) -> list[tuple[float, ExitRays]]:
    """Trace the camera's rays through each stock prism that admits its field."""
    found = []
    for side in PRISM_SIDES_MM:
        try:
            found.append((side, exit_rays(probe(wish.camera, wish.prism(side), range_wish))))
        except RigError:  # too small for the field, or nothing comes through: another one may do
            continue
    if not found:
        probe(
            wish.camera, wish.prism(PRISM_SIDES_MM[-1]), range_wish
        )  # says what is wrong with the camera, if that is it
        raise RigError(f"no stock prism of {wish.glass} shows anything to {wish.camera.name!r}: choose a denser glass")
    return found


def _mirror_angle_deg(wish: _Wish, rays: ExitRays, baseline_mm: float) -> float:
    """Return the mirror angle for the range, in steps that a workshop can set: choice 1 of the module's docstring."""
    near, far = (math.degrees(_angle(baseline_mm, z)) for z in (wish.near_mm, wish.far_mm))
    converging = min(max(near - (1 - _NEAR_SHARE) * rays.width_deg, far), (near + far) / 2)
    return round((parallel_angle_deg(rays) + converging / 4) / _ANGLE_STEP_DEG) * _ANGLE_STEP_DEG


def _angle(baseline_mm: float, distance_mm: float) -> float:
    """Return the angle, in radians, under which the baseline is seen from a point in front of its middle."""
    return 2 * math.atan(baseline_mm / 2 / distance_mm)


def _built(wish: _Wish, range_wish: RangeWish, side_mm: float, rays: ExitRays, name: str) -> PrismRig | None:
    prism = wish.prism(side_mm)
    angle_deg = round(_mirror_angle_deg(wish, rays, wish.baseline_mm), 2)
    if not (wish.baseline_mm > 0 and 45 < angle_deg < 75):
        return None
    mirrors = place(rays, prism, wish.camera.pupil_diameter_mm, angle_deg, wish.baseline_mm)
    if mirrors is None:
        return None
    return PrismRig(
        name=name,
        camera=wish.camera,
        range=range_wish,
        prism=prism,
        mirrors=msgspec.structs.replace(mirrors, height_mm=1000.0),
    )


def _chosen(candidates: list[tuple[PrismRig, ExitRays]]) -> PrismRig:
    """Return the smallest prism that shows nearly as much as the best: choice 3 of the module's docstring."""
    first = candidates[0][0]
    seam_px_mm = figures(first).seam_px * _apex_mm(
        first.prism
    )  # the band narrows as the apex moves away from the pupil

    def usable(rig: PrismRig, rays: ExitRays) -> float:
        video = rig.camera.video
        kept = len(rays.point_mm) / rig.views[0].rectangle(video.width, video.height)[2]
        return kept - seam_px_mm / _apex_mm(rig.prism) / video.width

    best = max(usable(rig, rays) for rig, rays in candidates)
    return next(rig for rig, rays in candidates if usable(rig, rays) >= best - _USABLE_SLACK)


def _apex_mm(prism: Prism) -> float:
    """Return how far from the pupil the apex seems to be, seen through the glass."""
    return prism.pupil_to_prism_mm + prism.height_mm / prism.index


def _require_overlap(rig: PrismRig, found: RigFigures) -> None:
    """Refuse a range at whose ends the views have next to nothing in common, and name the nearest that they share."""
    near, far = rig.range.near_mm, rig.range.far_mm
    if min(overlap_share(rig, near)[0], overlap_share(rig, far)[0]) >= _LEAST_SHARE:
        return
    spare = (1 - _MENDED_SHARE) * math.radians(found.half_field_deg[1] - found.half_field_deg[0])
    nearest = found.baseline_mm / 2 / math.tan(min(spare + _angle(found.baseline_mm, far) / 2, math.pi / 3))
    raise RigError(
        f"from {near:g} to {far:g} mm the two views of a baseline of {found.baseline_mm:.1f} mm have less than a tenth of "
        f"their width in common at one end: begin the range at {math.ceil(nearest)} mm, or ask for a smaller baseline"
    )


def _feasible(wish: _Wish, side_mm: float, rays: ExitRays, baseline_mm: float) -> bool:
    angle_deg = _mirror_angle_deg(wish, rays, baseline_mm)
    if not 45 < angle_deg < 75:
        return False
    return place(rays, wish.prism(side_mm), wish.camera.pupil_diameter_mm, angle_deg, baseline_mm) is not None


def _spans(wish: _Wish, side_mm: float, rays: ExitRays) -> Iterable[tuple[float, float]]:
    """Yield the stretches of baselines that one prism can give, to 0.1 mm, by scanning and then halving."""
    thin = rays.thinned(_SCAN_RAYS)
    steps = math.ceil(math.log(_LARGEST_BASELINE_MM / _SMALLEST_BASELINE_MM) / math.log(_SCAN_RATIO))
    scanned = [_SMALLEST_BASELINE_MM * _SCAN_RATIO**step for step in range(steps + 1)]
    good = [_feasible(wish, side_mm, thin, baseline) for baseline in scanned]
    begin = None
    for index, can in enumerate([*good, False]):
        if can and begin is None:
            begin = _edge(wish, side_mm, thin, scanned[index], scanned[max(index - 1, 0)])
        elif not can and begin is not None:
            yield begin, _edge(wish, side_mm, thin, scanned[index - 1], scanned[min(index, steps)])
            begin = None


def _edge(wish: _Wish, side_mm: float, rays: ExitRays, can: float, cannot: float) -> float:
    for _ in range(_HALVINGS):
        middle = (can + cannot) / 2
        can, cannot = (middle, cannot) if _feasible(wish, side_mm, rays, middle) else (can, middle)
    return can


def _baseline_complaint(wish: _Wish, benches: list[tuple[float, ExitRays]]) -> str:
    spans = [span for bench in benches for span in _spans(wish, *bench)]
    if not spans:
        return _no_mirrors(wish)
    nearest = min((end for span in spans for end in span), key=lambda end: abs(end - wish.baseline_mm))
    low, high = min(low for low, _ in spans), max(high for _, high in spans)
    return (
        f"baseline {wish.baseline_mm:g} mm cannot be had with {wish.camera.name}: {math.ceil(low)}..{math.floor(high)} mm "
        f"can, and {nearest:.1f} mm is nearest"
    )


def _no_mirrors(wish: _Wish) -> str:
    return (
        f"no stock mirrors give both views of {wish.camera.name!r} from {wish.near_mm:g} to {wish.far_mm:g} mm: begin the "
        "range farther away, bring the prism nearer to the lens, or take a narrower lens"
    )
