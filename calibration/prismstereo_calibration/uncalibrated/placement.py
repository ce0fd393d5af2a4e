"""Where the rectified pictures are cut: rows common to both, and columns so that all matches have a disparity above zero.

Without cameras there is no infinity and no range wish: the window is what the matches themselves span, and some more. A
pattern that repeats along a row, of a wallpaper or a board, gives wrong matches that no geometry gives away; they lie far off
the others, so the window is sought where most of the matches are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.uncalibrated.epipolar import mapped
from prismstereo_calibration.uncalibrated.pictures import ViewPictures

__all__ = ["Placement", "place"]

Array = NDArray[np.float64]

_MOST_SPAN = 0.5  # of the picture's width: what is nearer than that is hardly in both views
_DISPARITIES = 16  # that stand for all of the window
_LABEL_STEP = 16  # what every matcher counts in
_EXTREMES = (0.5, 99.5)  # percentiles of the matches' disparities
_MARGIN, _LEAST_MARGIN_PX = 0.1, 2.0  # beyond them on either side: a share of their span, and pixels


@dataclass(frozen=True, slots=True)
class Placement:
    """Final homographies (3, 3) from upright to rectified pixels, the pictures' size, labels, and their scale."""

    H_left: Array
    H_right: Array
    width: int
    height: int
    labels: int
    scale: float


def place(
    H_left: Array, H_right: Array, left: Array, right: Array, pictures: ViewPictures, most_labels: int
) -> Placement:
    """Shift (and, where the search would be longer than `most_labels`, shrink) evened homographies into pictures.

    The usual disparities of the matches (N, 2) come to lie within 1 .. labels - 2. The rows are those of the middles of the
    views, the columns those that hold most of what both views see within the window. `CalibrationError` where nothing of one
    view would be left.
    """
    disparity = mapped(H_left, left)[:, 0] - mapped(H_right, right)[:, 0]
    usual = _usual(disparity, _MOST_SPAN * pictures.width)
    low, high = (float(end) for end in np.percentile(disparity[usual], _EXTREMES))
    margin = max(_MARGIN * (high - low), _LEAST_MARGIN_PX)
    low, high = low - margin, high + margin
    scale = min(1.0, (most_labels - 3) / (high - low))
    needed = math.ceil(scale * (high - low)) + 3
    labels = min(-(-needed // _LABEL_STEP) * _LABEL_STEP, most_labels)
    width, height = (max(1, round(scale * side)) for side in (pictures.width, pictures.height))
    # the middles of the sides of both views: top, right, bottom, left
    corners = [pictures.corners(side) for side in (0, 1)]
    sides = [(box + np.roll(box, -1, axis=0)) / 2 for box in corners]
    left_sides, right_sides = (scale * mapped(H, each) for H, each in zip((H_left, H_right), sides, strict=True))
    left_sides[:, 0] += 1 - scale * low  # by so much farther the left picture is shifted to the right
    across = _most_common(left_sides[[3, 1], 0], right_sides[[3, 1], 0], width, labels)
    down = (height - 1) / 2 - (left_sides[:, 1].mean() + right_sides[:, 1].mean()) / 2
    placed = Placement(
        _shifted(H_left, scale, across + 1 - scale * low, down),
        _shifted(H_right, scale, across, down),
        width,
        height,
        labels,
        scale,
    )
    _require_common(placed, left[usual], right[usual])
    return placed


def _usual(disparity: Array, span: float) -> NDArray[np.bool_]:
    """Tell which disparities (N,) lie in the interval of that span that holds most of them."""
    ordered = np.sort(disparity)
    held = np.searchsorted(ordered, ordered + span, side="right") - np.arange(len(ordered))
    first = ordered[int(np.argmax(held))]
    return np.asarray((disparity >= first) & (disparity <= first + span))


def _most_common(left: Array, right: Array, width: int, labels: int) -> float:
    """Return how far to shift views with these first and last columns (2,), so that most of the window has a place in both.

    A point at x in the left picture lies at x - d in the right one. Counted: columns x, for all disparities d of the window,
    that lie in both views and both pictures.
    """
    d = np.linspace(1, labels - 2, _DISPARITIES)
    centred = (width - 1) / 2 - (left.sum() + right.sum()) / 4
    shift = centred + np.arange(-width, width + 1)[:, None]
    low = np.maximum(np.maximum(left[0] + shift, right[0] + shift + d), d)
    high = np.minimum(np.minimum(left[1] + shift, right[1] + shift + d), width - 1)
    common = np.maximum(high - low, 0).sum(axis=1)
    best = shift[common >= common.max() - 1e-9, 0]
    return float(best[np.argmin(np.abs(best - centred))])


def _shifted(H: Array, scale: float, across: float, down: float) -> Array:
    shifted = np.array([[scale, 0.0, across], [0.0, scale, down], [0.0, 0.0, 1.0]]) @ H
    return np.asarray(shifted / shifted[2, 2] if abs(shifted[2, 2]) > 1e-6 else shifted)


def _require_common(placed: Placement, left: Array, right: Array) -> None:
    """Refuse pictures in which half of the matches have no place."""
    box = np.array([placed.width, placed.height])
    inside = np.ones(len(left), bool)
    for H, points in ((placed.H_left, left), (placed.H_right, right)):
        at = mapped(H, points)
        inside &= np.all((at >= 0) & (at < box), axis=1)
    if inside.mean() < 0.5:
        raise CalibrationError(
            f"only {100 * inside.mean():.0f} % of the matches have a place in both rectified pictures: the views show too "
            "different parts of the scene, check where they lie"
        )
