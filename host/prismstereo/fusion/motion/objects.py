"""The moving objects of a frame: which part of the still each of them is, and how it moved since."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.change import ChangeMask
from prismstereo.fusion.motion.evidence import Evidence, fine_frame, weigh
from prismstereo.fusion.motion.features import Features
from prismstereo.fusion.motion.models import FlatMotion, MotionModel, Relief
from prismstereo.fusion.motion.picture import HALF_STEP, grey
from prismstereo.fusion.motion.prepared_still import BLURS_PX, PreparedStill, StillPart
from prismstereo.fusion.motion.refinement import followed_corners
from prismstereo.fusion.motion.selection import Fit, best_fit, peeled
from prismstereo.fusion.motion.streak import Streak

__all__ = ["MovingObject", "objects_in"]

Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]
_REFINEMENTS = 4
_REFINED_REACH_PX = 0.4
_MOST_CANDIDATES = 6
_MOST_LAYERS = 3
_LEFT_SHARE = 0.15  # of a part that no model explains yet: worth another model
_SURE_EDGE_PX = 0.4  # video pixels that the outline may be off, one standard deviation
_BEYOND_DOUBT = 0.97  # of an object: no other model need be tried
_RESTING_SHARE = 0.85  # of an object at rest that must look the same
_LEFT_PLACE = 0.1  # of its place that may look like background
_STREAKS_PX = (6.0, 10.0)
_STREAK_ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
_STREAKED_REACH_PX = 1.5
_LOOK_PX = 6  # around what changed in the frame


@dataclass(frozen=True, slots=True)
class MovingObject:
    """A part of the still, or a piece of one that moves on its own, and what became of it in the frame.

    `part` is its number in the still and `layer` counts the motions within it. `in_still` and `in_frame` are (height, width)
    bool in video pixels. `evidence` holds its model; None where none is trusted, and then `why` says so. `edge_px` is the
    standard deviation of where its outline comes to lie, in video pixels, NaN without a model.
    """

    part: int
    layer: int
    in_still: Mask
    in_frame: Mask
    evidence: Evidence | None
    edge_px: float
    matches: int
    why: str = ""

    @property
    def trusted(self) -> bool:
        """Tell whether the still is shown for this object."""
        return self.evidence is not None

    @property
    def model(self) -> MotionModel | None:
        """How it moved, if that is known."""
        return None if self.evidence is None else self.evidence.model


@dataclass(frozen=True, slots=True)
class _Trial:
    evidence: Evidence
    edge_px: float
    matches: int


def objects_in(
    frame: Picture, change: ChangeMask, still: PreparedStill, relief: Relief | None = None
) -> list[MovingObject]:
    """Find every object of the still in a frame (height, width[, 3]) uint8, in order of the parts' numbers.

    Parts that give no model of their own may follow one of another part: a thing often falls into several parts.
    """
    if not still.parts:
        return []
    seen = _features(frame, change)
    at_rest = FlatMotion("still", change.pose @ np.linalg.inv(still.change.pose))
    found = [_fits(part, seen, relief) for part in still.parts]
    ranked = sorted((fit for fits in found for fit in fits), key=lambda fit: -fit.support)
    objects: list[MovingObject] = []
    for part, own in zip(still.parts, found, strict=True):
        others = [fit for fit in ranked if not any(fit is mine for mine in own)]
        candidates = (own + others)[:_MOST_CANDIDATES]
        objects += _layers(part, candidates, at_rest, frame, change, still, relief)
    return objects


def _features(frame: Picture, change: ChangeMask) -> tuple[Features, ...]:
    flat = grey(frame)
    size = (flat.shape[1] * HALF_STEP, flat.shape[0] * HALF_STEP)
    fine = np.asarray(cv2.resize(flat, size, interpolation=cv2.INTER_CUBIC), np.float32)
    around = cv2.dilate(change.changed.astype(np.uint8), np.ones((2 * _LOOK_PX + 1,) * 2, np.uint8))
    where = cv2.resize(around, fine.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    return tuple(Features.of(fine, mask=where, factor=HALF_STEP, blur_px=blur) for blur in BLURS_PX)


def _fits(part: StillPart, seen: tuple[Features, ...], relief: Relief | None) -> list[Fit]:
    """Fit models to the matches of a part, sharp and smoothed; those with most support first."""
    fits = [
        fit for ours, theirs in zip(part.features, seen, strict=True) for fit in peeled(ours.matched(theirs), relief)
    ]
    return sorted(fits, key=lambda fit: -fit.support)


def _streaked_fits(
    part: StillPart, frame: Picture, change: ChangeMask, still: PreparedStill, relief: Relief | None
) -> list[Fit]:
    """Fit models to matches with a frame that is badly blurred by motion: the still gets the same streak, of a few tried."""
    fine = grey(still.fine)
    where = cv2.resize(part.mask.astype(np.uint8), fine.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    seen = _features(frame, change)[0]
    fits: list[Fit] = []
    for length in _STREAKS_PX:
        for angle in _STREAK_ANGLES_DEG:
            streaked = Streak(length, angle).over(fine, HALF_STEP)
            ours = Features.of(streaked, mask=where, factor=HALF_STEP)
            fit = best_fit(ours.matched(seen), relief, _STREAKED_REACH_PX)
            fits += [] if fit is None else [fit]
    return sorted(fits, key=lambda fit: -fit.support)[:_MOST_CANDIDATES]


def _layers(
    part: StillPart, candidates: list[Fit], at_rest: FlatMotion, frame: Picture, change: ChangeMask, still: PreparedStill,
    relief: Relief | None,
) -> list[MovingObject]:  # fmt: skip
    """Give a part its model, and what that one leaves unexplained the next."""
    left, layers = part.mask, []
    area = int(part.mask.sum())
    trials: list[_Trial] = []
    for number in range(_MOST_LAYERS):
        trials = _convincing(left, candidates, at_rest, frame, change, still, relief)
        if not trials and number == 0:
            candidates = _streaked_fits(part, frame, change, still, relief)
            trials = _convincing(left, candidates, None, frame, change, still, relief)
        if not trials:
            break
        best = max(trials, key=lambda trial: trial.evidence.support)
        rest = _unexplained(left, best.evidence)
        mine = left & ~rest if rest.sum() > _LEFT_SHARE * area else left
        layers.append(_object(part, number, mine, best))
        left = rest if mine is not left else np.zeros_like(left)
        if not left.any():
            break
    if left.any():
        why = _why(part, candidates)
        layers.append(
            MovingObject(part.number, len(layers), left, np.zeros_like(left), None, np.nan, _most(candidates), why)
        )
    return layers


def _convincing(
    mask: Mask, candidates: list[Fit], at_rest: FlatMotion | None, frame: Picture, change: ChangeMask, still: PreparedStill,
    relief: Relief | None,
) -> list[_Trial]:  # fmt: skip
    """Try models on a part, make them finer, and return those that convince."""
    trials = []
    resting = None if at_rest is None else weigh(at_rest, mask, still.fine, frame, change)
    if resting is not None and _rests(resting):
        trials.append(_Trial(resting, 0.0, 0))
    for fit in candidates:
        evidence = weigh(fit.model, mask, still.fine, frame, change)
        if evidence is None:
            continue
        trial = _refined(
            _Trial(evidence, _edge_px(fit, evidence, None), fit.support), mask, frame, change, still, relief
        )
        if trial.edge_px <= _SURE_EDGE_PX:
            trials.append(trial)
        if (
            trial.edge_px <= _SURE_EDGE_PX / 4
            and trial.evidence.convincing
            and trial.evidence.explained >= _BEYOND_DOUBT
        ):
            break
    return [trial for trial in trials if trial.evidence.convincing]


def _rests(evidence: Evidence) -> bool:
    """Tell whether an object said to be at rest is still there: the background explains nothing of its place."""
    return evidence.explained >= _RESTING_SHARE and int(evidence.hidden.sum()) <= _LEFT_PLACE * int(
        evidence.visible.sum()
    )


def _refined(
    trial: _Trial, mask: Mask, frame: Picture, change: ChangeMask, still: PreparedStill, relief: Relief | None
) -> _Trial:
    """Follow corners and fit again; a finer model stays only if it explains no less."""
    for _ in range(_REFINEMENTS):
        old = trial.evidence
        core = cv2.erode((old.visible & ~old.hidden).astype(np.uint8), np.ones((7, 7), np.uint8))
        inside = cv2.resize(core, old.fine.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        model = old.streak.over(old.fine, HALF_STEP)
        matches = followed_corners(fine_frame(frame, old.box), model, inside, old.model, old.box)
        fit = None if matches is None else best_fit(matches, relief, _REFINED_REACH_PX)
        if fit is None or matches is None:
            break
        evidence = weigh(fit.model, mask, still.fine, frame, change)
        if evidence is None or evidence.explained < old.explained - 0.02 or evidence.support < 0.85 * old.support:
            break
        trial = _Trial(evidence, _edge_px(fit, evidence, matches.ours[fit.inliers]), fit.support)
    return trial


def _edge_px(fit: Fit, evidence: Evidence, points: NDArray[np.float64] | None) -> float:
    """Estimate how far off the outline may be, one standard deviation in video pixels.

    A model is as sure as its matches are many, and less so away from them: the textbook variance of a line's prediction, for
    both axes, with the model's freedoms for a factor.
    """
    rows, columns = np.nonzero(evidence.visible)
    outline = np.column_stack([columns, rows])
    if points is None or len(points) < 3:
        reach, width = 1.0, 1.0
    else:
        reach = float(np.ptp(outline, axis=0).max()) / 2
        width = float(points.std(axis=0).min()) + 1e-6
    share = (1 + (reach / width) ** 2 / 2) / fit.support
    return fit.spread_px * float(np.sqrt(share * fit.model.freedoms / 4))


def _unexplained(left: Mask, evidence: Evidence) -> Mask:
    """Return what of a part a model leaves unexplained, in the still's pixels: whole patches only."""
    against = evidence.visible & (evidence.unlike > 4) & ~evidence.hidden
    patches = cv2.morphologyEx(against.astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    inside = np.zeros(left.shape, np.float32)
    rows, columns = np.nonzero(patches)
    points = np.column_stack([columns + evidence.box.left, rows + evidence.box.top]).astype(np.float64)
    if len(points):
        places = evidence.model.in_still(points)
        places = np.rint(places[np.isfinite(places).all(axis=1)]).astype(int)
        within = np.all((places >= 0) & (places < left.shape[::-1]), axis=1)
        inside[places[within, 1], places[within, 0]] = 1
    grown = cv2.morphologyEx(inside, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0
    return np.asarray(left & grown)


def _object(part: StillPart, layer: int, mask: Mask, trial: _Trial) -> MovingObject:
    evidence = trial.evidence
    in_frame = np.zeros(mask.shape, bool)
    in_frame[evidence.box.cut] = evidence.visible & ~evidence.hidden
    return MovingObject(part.number, layer, mask, in_frame, evidence, trial.edge_px, trial.matches)


def _most(candidates: list[Fit]) -> int:
    return max((fit.support for fit in candidates), default=0)


def _why(part: StillPart, candidates: list[Fit]) -> str:
    if not candidates:
        return f"{len(part.features[0].points)} features, too few matches: textureless, blurred, or not in the frame"
    return "no motion that the matches allow explains what the frame shows"
