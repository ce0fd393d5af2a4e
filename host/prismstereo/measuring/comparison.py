"""Two accounts of depth quality held side by side: what became better, and what worse.

Flat targets belong together where their distances differ by less than 15 %, the nearest first; scenes by their order, and their
bins by their distances.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from prismstereo.measuring.account import Account, FlatTarget, TrueScene
from prismstereo.measuring.truth_bins import TruthBin

__all__ = ["Change", "compare"]

_SAME_DISTANCE = 0.15
_SAME_FIGURE = 0.02  # of the figure: less is no change


@dataclass(frozen=True, slots=True)
class Change:
    """A figure before and after; `verdict` says which is better: "better", "worse" or "same"."""

    figure: str
    where: str
    before: float
    after: float
    verdict: str

    @classmethod
    def of(cls, figure: str, where: str, before: float | None, after: float | None, *, more: bool) -> Change | None:
        """Compare a figure of which more, or less, is better; None where one of the two is not known."""
        if before is None or after is None or not (math.isfinite(before) and math.isfinite(after)):
            return None
        gained = (abs(after) - abs(before)) * (1 if more else -1)
        same = abs(gained) <= _SAME_FIGURE * max(abs(before), abs(after))
        return cls(figure, where, before, after, "same" if same else "better" if gained > 0 else "worse")


def compare(before: Account, after: Account) -> tuple[Change, ...]:
    """Return the changes of all figures that both accounts have of the same thing."""
    found: list[Change | None] = []
    for target in after.flat:
        other = _nearest(target, before.flat)
        if other is not None:
            found += _flat(other, target)
    for number, (earlier, scene) in enumerate(zip(before.scenes, after.scenes, strict=False), start=1):
        found += _scene(f"scene {number}", earlier, scene)
    return tuple(change for change in found if change is not None)


def _nearest(target: FlatTarget, others: Iterable[FlatTarget]) -> FlatTarget | None:
    def apart(other: FlatTarget) -> float:
        return abs(math.log(other.figures.distance_mm / target.figures.distance_mm))

    best = min(others, key=apart, default=None)
    return best if best is not None and apart(best) < _SAME_DISTANCE else None


def _flat(before: FlatTarget, after: FlatTarget) -> Iterator[Change | None]:
    where = f"flat, {after.figures.distance_mm:.0f} mm"
    one, other = before.figures, after.figures
    gaps = [
        None if target.triangulation_gap_mm is None else target.triangulation_gap_mm.mean for target in (before, after)
    ]
    yield Change.of("fill rate, %", where, one.fill_percent, other.fill_percent, more=True)
    yield Change.of("Z accuracy, %", where, one.z_accuracy_percent, other.z_accuracy_percent, more=False)
    yield Change.of("plane-fit RMS, % of distance", where, one.plane_rms_percent, other.plane_rms_percent, more=False)
    yield Change.of("sub-pixel RMS, px", where, one.subpixel_rms_px, other.subpixel_rms_px, more=False)
    yield Change.of("temporal noise, mm rms", where, one.temporal_rms_mm, other.temporal_rms_mm, more=False)
    yield Change.of("triangulation gap, mm", where, gaps[0], gaps[1], more=False)


def _scene(name: str, before: TrueScene, after: TrueScene) -> Iterator[Change | None]:
    yield Change.of("disparity levels in use", name, before.levels.in_use, after.levels.in_use, more=True)
    for one in after.by_distance:
        other = next(
            (some for some in before.by_distance if abs(math.log(_middle(some) / _middle(one))) < _SAME_DISTANCE), None
        )
        if other is None:
            continue
        where = f"{name}, {one.from_mm:.0f} to {one.to_mm:.0f} mm"
        yield Change.of("fill rate, %", where, other.fill_percent, one.fill_percent, more=True)
        yield Change.of("matches more than 1 px off, %", where, other.bad_percent, one.bad_percent, more=False)
        if one.errors is not None and other.errors is not None:
            yield Change.of(
                "disparity RMS, px", where, other.errors.disparity_rms_px, one.errors.disparity_rms_px, more=False
            )
            yield Change.of(
                "depth RMS, %", where, other.errors.depth_rms_percent, one.errors.depth_rms_percent, more=False
            )


def _middle(one: TruthBin) -> float:
    return math.sqrt(one.from_mm * one.to_mm)
