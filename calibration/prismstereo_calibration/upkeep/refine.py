"""Mend the pose of a unit whose mirrors crept, from scenes of any kind; the scale from one known distance.

Rows tell how the views stand to each other, but only weakly how much they converge, and nothing at all of the baseline. What
the mount can do (`mount`) ties these together; how well the lens is known (`doubts`) limits what rows can say of convergence:
to one per cent of the depth at one metre behind a lens known to 0.15 %, to a few where rows are sure to a hundredth of a
pixel. Unless a change is surely seen, convergence therefore stays as it was; one known distance settles it. The new pose is
judged on scenes that it has not seen, and counts only where it is better there by clearly more than chance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.poses import angle_deg, rotation
from prismstereo_calibration.upkeep.depth_probe import DepthProbe
from prismstereo_calibration.upkeep.doubts import doubts_px
from prismstereo_calibration.upkeep.mount import Mount
from prismstereo_calibration.upkeep.pose_fit import KnownDepth, Pose, PoseFit, fit_pose, spread
from prismstereo_calibration.upkeep.sightlines import SceneMatches, Sightlines

__all__ = [
    "FARTHEST",
    "FEWEST_MATCHES",
    "FEWEST_SCENES",
    "Convergence",
    "Move",
    "Refinement",
    "refine",
    "require_matches",
]

Array = NDArray[np.float64]
Convergence = Literal["by a known distance", "by the rows", "as it was"]

FARTHEST = 5.0  # standard deviations of a mount: half a degree of a mirror is no creep
FEWEST_SCENES = 4
FEWEST_MATCHES = 40  # of a scene that counts
_FOLDS = 5
_CLEARLY = 3.0  # standard errors
_NOT_WORSE = -2.0
_NOTICEABLE_PX = 0.02  # by which rows must move, as a standard deviation, for it to be worth a new file
_SURELY = 2.0  # standard deviations by which rows must show another depth before convergence is touched
_KEPT = 0.0005  # of the depth, where convergence stays as it was
_SOFT = 2.4  # sigmas, as in the fit


@dataclass(frozen=True, slots=True)
class Move:
    """One way in which the mount gave way: its name ends in its unit."""

    way: str
    amount: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Refinement:
    """The refined calibration, whether it is better than the old one, and by what.

    `rows_before_px`, `rows_after_px`: robust standard deviation of the vertical disparity in scenes held back. `gain_sigmas`:
    the gain there over its standard error. `known_before`, `known_after`: relative error of the known distance, NaN without
    one. `depth_change`: by what share of itself a depth of `at_depth` grows; `depth_sigma`: how well depth there is known, even
    where convergence stays as it was. `convergence`: what it rests on.
    """

    calibration: Calibration
    better: bool
    reason: str
    scenes: int
    matches: int
    rows_before_px: float
    rows_after_px: float
    gain_sigmas: float
    turn_deg: float
    baseline_change: float
    at_depth: float
    depth_change: float
    depth_sigma: float
    known_before: float
    known_after: float
    convergence: Convergence
    moves: tuple[Move, ...]


def require_matches(scenes: Sequence[SceneMatches], fewest: int) -> list[SceneMatches]:
    """Return the scenes that show enough; `CalibrationError` where too few do."""
    kept = [scene for scene in scenes if len(scene.left_px) >= FEWEST_MATCHES]
    if len(kept) < fewest:
        poor = [f"{scene.name} ({len(scene.left_px)})" for scene in scenes if len(scene.left_px) < FEWEST_MATCHES]
        named = (
            f"; too few points in both views of {', '.join(poor[:5])}{' ...' if len(poor) > 5 else ''}" if poor else ""
        )
        raise CalibrationError(
            f"{len(kept)} of {len(scenes)} scenes show {FEWEST_MATCHES} points in both views, and {fewest} such scenes are "
            f"needed{named}: let the unit look at textured things at several distances, in focus and well lit"
        )
    return kept


def refine(
    calibration: Calibration, scenes: Sequence[SceneMatches], mount: Mount, known: KnownDepth | None = None
) -> Refinement:
    """Fit the pose of the right camera to scenes, and judge it on each part of them by a fit to the others.

    `CalibrationError` for too few scenes with too few points; a refinement that is not `better` says why, and its calibration
    is the old one.
    """
    seen = require_matches(scenes, FEWEST_SCENES)
    lines, probe = Sightlines.of(calibration, seen), DepthProbe.of(calibration)
    doubts = doubts_px(calibration, seen, mount.plate)
    fit = fit_pose(lines, doubts, calibration.right, mount, known)
    sigma = probe.sigma(calibration, mount, fit.amounts, fit.covariance)
    sure = known is not None or abs(probe.change(fit.R, fit.t)) > _SURELY * sigma
    tie = known if sure else KnownDepth(probe.lines, probe.depth, _KEPT * probe.depth, probe.ahead)
    fit = fit if sure else fit_pose(lines, doubts, calibration.right, mount, tie)
    before, after = _held_back(calibration, lines, doubts, mount, tie)
    gain = _gain_sigmas(before, after, lines.scene)
    worth = gain if spread(lines.rows_px(fit.R, fit.t) - before) > _NOTICEABLE_PX else min(gain, 0.0)
    objection = _objection(fit, mount, worth, _known_off(calibration, fit, known), sure=sure)
    refined = _with_pose(calibration, fit)
    return Refinement(
        calibration=calibration if objection else refined,
        better=not objection,
        reason=objection or "better on scenes held back",
        scenes=len(seen),
        matches=len(lines.scene),
        rows_before_px=spread(before),
        rows_after_px=spread(after),
        gain_sigmas=gain,
        turn_deg=angle_deg(fit.R, calibration.right.R_camera_from_left),
        baseline_change=refined.baseline - calibration.baseline,
        at_depth=probe.depth,
        depth_change=probe.change(fit.R, fit.t),
        depth_sigma=sigma,
        known_before=_relative(known, _pose(calibration)),
        known_after=_relative(known, (fit.R, fit.t)),
        convergence="as it was" if not sure else "by the rows" if known is None else "by a known distance",
        moves=_moves(mount, fit),
    )


def _moves(mount: Mount, fit: PoseFit) -> tuple[Move, ...]:
    sigmas = np.sqrt(np.diag(fit.covariance)) * mount.sizes
    amounts = fit.amounts * mount.sizes
    return tuple(
        Move(way, float(amount), float(sigma)) for way, amount, sigma in zip(mount.ways, amounts, sigmas, strict=True)
    )


def _pose(calibration: Calibration) -> Pose:
    return calibration.right.R_camera_from_left, calibration.right.t_camera_from_left


def _with_pose(calibration: Calibration, fit: PoseFit) -> Calibration:
    right = replace(calibration.right, R_camera_from_left=rotation(fit.R), t_camera_from_left=fit.t)
    return replace(calibration, right=right)


def _held_back(
    calibration: Calibration, lines: Sightlines, doubts: Array, mount: Mount, known: KnownDepth | None
) -> tuple[Array, Array]:
    """Return the vertical disparities (N,) by the old pose, and by the pose that all scenes but their own fold give."""
    before = lines.rows_px(*_pose(calibration))
    after = np.empty_like(before)
    folds = min(_FOLDS, int(lines.scene.max()) + 1)
    for fold in range(folds):
        away = lines.scene % folds == fold
        fit = fit_pose(lines.only(~away), doubts[~away], calibration.right, mount, known)
        after[away] = lines.only(away).rows_px(fit.R, fit.t)
    return before, after


def _gain_sigmas(before: Array, after: Array, scene: NDArray[np.int64]) -> float:
    """Return how much smaller the disparities became, over the standard error of that as the scenes themselves vary."""
    scale = _SOFT * spread(after)
    gain = np.log1p((before / scale) ** 2) - np.log1p((after / scale) ** 2)
    each = np.array([gain[scene == index].mean() for index in np.unique(scene)])
    error = float(each.std(ddof=1)) / math.sqrt(len(each))
    return float(each.mean()) / max(error, 1e-9)


def _relative(known: KnownDepth | None, pose: Pose) -> float:
    if known is None:
        return math.nan
    return 1 / (known.depth * float(np.median(known.lines.nearness(*pose, known.ahead)))) - 1


def _known_off(calibration: Calibration, fit: PoseFit, known: KnownDepth | None) -> float:
    """Return by how many standard deviations the old pose misses the known depth; 0 without one."""
    if known is None:
        return 0.0
    pose = _pose(calibration)
    return abs(known.off_px(*pose)) / known.sigma_px(fit.sigma_px, pose[1])


def _objection(fit: PoseFit, mount: Mount, gain: float, known_off: float, *, sure: bool) -> str | None:
    """Say why the refined pose must not be taken; None where it may. `known_off`: of the old one, in sigmas."""
    worst = int(np.argmax(np.abs(fit.amounts)))
    if abs(fit.amounts[worst]) > FARTHEST:
        way, _, unit = mount.ways[worst].replace("_", " ").rpartition(" ")
        return (
            f"{way} would be {fit.amounts[worst] * mount.sizes[worst]:.2f} {unit}, more than a mount creeps: this is not "
            "that unit, or it was knocked; calibrate again with a board"
        )
    if gain > _CLEARLY or (known_off > _CLEARLY and gain > _NOT_WORSE):
        return None
    return (
        f"the calibration is not clearly better on scenes held back (worth {gain:.1f} standard errors, {_CLEARLY:g} needed): "
        f"keep the old one, or give more scenes of more texture{'' if sure else ' and one known distance'}"
    )
