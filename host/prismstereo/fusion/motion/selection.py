"""Which model the matches speak for: the one that leaves least over, after its own freedom is paid for.

The residuals of all models are taken in the still, in video pixels, and weighed by one spread: that of the model that fits
best. The cost of a match saturates, so that wrong ones do not decide (Torr's robust information criterion).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.features import Matches
from prismstereo.fusion.motion.models import FlatMotion, MotionModel, Relief, fit_flat, fit_rigid

__all__ = ["FEWEST_MATCHES", "Fit", "best_fit", "peeled"]

FEWEST_MATCHES = 8
_MOST_MODELS = 5
_SATURATION = 9.0  # squared spreads
_SPREAD_FLOOR_PX = 0.03
_SCALES = (0.5, 2.0)  # an object that grew or shrank more was matched by chance


@dataclass(frozen=True, slots=True)
class Fit:
    """A model, the matches that obey it (n,) bool among those given, and their spread in video pixels."""

    model: MotionModel
    inliers: NDArray[np.bool_]
    spread_px: float

    @property
    def support(self) -> int:
        """How many matches obey the model."""
        return int(self.inliers.sum())


def best_fit(matches: Matches, relief: Relief | None = None, reach_px: float = 1.0) -> Fit | None:
    """Fit every kind of model to the matches, still to frame, and return the one they speak for; None for too few."""
    if len(matches) < FEWEST_MATCHES:
        return None
    similar = fit_flat(matches, "similarity", reach_px)
    candidates: list[MotionModel | None] = [similar, fit_flat(matches, "homography", reach_px)]
    if relief is not None:
        candidates.append(fit_rigid(matches, relief, reach_px))
    models = [m for m in candidates if m is not None and _plausible(m, matches)]
    if not models:
        return None
    residuals = [_residuals(model, matches) for model in models]
    spread = max(_SPREAD_FLOOR_PX, min(_spread(r, reach_px) for r in residuals))
    costs = [
        float(np.minimum((r / spread) ** 2, _SATURATION).sum()) + model.freedoms * np.log(4 * len(matches))
        for r, model in zip(residuals, models, strict=True)
    ]
    chosen = int(np.argmin(costs))
    inliers = residuals[chosen] < reach_px
    if inliers.sum() < FEWEST_MATCHES:
        return None
    return Fit(models[chosen], inliers, max(_SPREAD_FLOOR_PX, _spread(residuals[chosen], reach_px)))


def peeled(matches: Matches, relief: Relief | None = None, reach_px: float = 1.0) -> list[Fit]:
    """Fit one model after the other, each to the matches that the ones before left over; most support first found."""
    left = np.arange(len(matches))
    fits: list[Fit] = []
    while len(fits) < _MOST_MODELS:
        fit = best_fit(matches.chosen(left), relief, reach_px)
        if fit is None:
            break
        inliers = np.zeros(len(matches), bool)
        inliers[left[fit.inliers]] = True
        fits.append(Fit(fit.model, inliers, fit.spread_px))
        # what lies near the model is no model of its own
        near = _residuals(fit.model, matches.chosen(left)) < 3 * reach_px
        left = left[~near]
    return fits


def _residuals(model: MotionModel, matches: Matches) -> NDArray[np.float64]:
    away = np.hypot(*(model.in_still(matches.theirs) - matches.ours).T)
    return np.asarray(np.where(np.isfinite(away), away, np.inf))


def _spread(residuals: NDArray[np.float64], reach_px: float) -> float:
    """Return the standard deviation of one coordinate, told robustly from distances of the matches within reach."""
    near = residuals[residuals < reach_px]
    return float(np.median(near)) / 1.1774 if near.size >= FEWEST_MATCHES else np.inf


def _plausible(model: MotionModel, matches: Matches) -> bool:
    """Tell whether a model neither folds nor resizes the matched part beyond belief."""
    if not isinstance(model, FlatMotion) or model.kind == "still":
        return True
    points = matches.ours
    low, high = np.percentile(points, [10, 90], axis=0)
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    if min(high - low) < 1:
        return True
    moved = model.in_frame(corners)
    if not np.isfinite(moved).all():
        return False
    area = _area(moved) / _area(corners)
    return bool(_SCALES[0] ** 2 < area < _SCALES[1] ** 2)


def _area(corners: NDArray[np.float64]) -> float:
    """Return the signed area of a polygon (n, 2)."""
    x, y = corners.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
