"""The gain between both views from any textured scene: how bright the same thing is in the one and in the other.

Patches of the left rectified picture are looked for along their rows in the right one by normalised correlation, which does
not care for brightness. Where a patch is found beyond doubt, the ratio of both brightnesses is one vote; the median of all
votes is the gain. Glossy things, which really look different from two places, are outvoted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification

__all__ = ["GainBetween", "gain_between"]

Grey = NDArray[np.float32]

_PATCH_PX = 15
_STEP_PX = 24
_SLACK_PX = 2  # rows by which a match may be off: the calibration is not perfect
_LEAST_CONTRAST = 4.0  # standard deviation of a patch, grey levels
_CLEAR = 0.9  # correlation of a match,
_UNIQUE = 0.08  # and by how much all places further off must fall behind
_LEAST_GREY, _MOST_GREY = 16.0, 235.0
_LEAST_VOTES = 30
_NORMAL = 1.4826  # median deviation to standard deviation


@dataclass(frozen=True, slots=True)
class GainBetween:
    """What the right view must be multiplied by, its one-sigma uncertainty (relative), and how many patches voted."""

    right_gain: float
    sigma: float
    votes: int


def gain_between(frames: Sequence[NamedFrame], calibration: Calibration, black_grey: float = 0.0) -> GainBetween:
    """Measure the gain between the views from raw frames of an ordinary scene, or several.

    `CalibrationError` where fewer than 30 patches are found again: no texture, or a calibration that is not this unit's.
    """
    rectified = rectification(calibration)
    ratios: list[float] = []
    for frame in frames:
        left, right = _rectified(frame, calibration, rectified)
        ratios += _votes(left, right, rectified.window.labels, black_grey)
    if len(ratios) < _LEAST_VOTES:
        raise CalibrationError(
            f"{len(ratios)} patches of {len(frames)} frames are found in both views, and {_LEAST_VOTES} are the least: show "
            "something textured within the range, or measure a flat field"
        )
    logs = np.log(ratios)
    middle = float(np.median(logs))
    spread = _NORMAL * float(np.median(np.abs(logs - middle)))
    return GainBetween(math.exp(middle), 1.25 * spread / math.sqrt(len(ratios)), len(ratios))


def _rectified(frame: NamedFrame, calibration: Calibration, rectified: Rectification) -> tuple[Grey, Grey]:
    """Return both rectified pictures, NaN where there is nothing."""
    pictures: list[Grey] = []
    for side, view in zip((rectified.left, rectified.right), calibration.views, strict=True):
        cut = np.ascontiguousarray(view.cut(frame.pixels))
        grey = cv2.cvtColor(cut, cv2.COLOR_BGR2GRAY) if cut.ndim == 3 else cut
        sources = rectified.sources(side)
        filled = np.nan_to_num(sources, nan=-16.0)
        picture = cv2.remap(grey.astype(np.float32), filled[..., 0], filled[..., 1], cv2.INTER_LINEAR)
        pictures.append(np.where(np.isfinite(sources[..., 0]), picture, np.nan).astype(np.float32))
    return pictures[0], pictures[1]


def _votes(left: Grey, right: Grey, labels: int, black_grey: float) -> list[float]:
    """Return the left brightness over the right one of every patch that is found again beyond doubt."""
    height, width = left.shape
    found: list[float] = []
    searched = np.nan_to_num(right, nan=0.0)
    for top in range(_SLACK_PX, height - _PATCH_PX - _SLACK_PX, _STEP_PX):
        for first in range(0, width - _PATCH_PX, _STEP_PX):
            patch = left[top : top + _PATCH_PX, first : first + _PATCH_PX]
            if not np.isfinite(patch).all() or patch.std() < _LEAST_CONTRAST:
                continue
            begin = max(0, first - labels)
            rows = slice(top - _SLACK_PX, top + _PATCH_PX + _SLACK_PX)
            at = _found_at(patch, searched[rows, begin : first + _PATCH_PX])
            if at is None:
                continue
            y, x = at
            match = right[rows, begin : first + _PATCH_PX][y : y + _PATCH_PX, x : x + _PATCH_PX]
            if not np.isfinite(match).all() or max(patch.max(), match.max()) > _MOST_GREY:
                continue
            levels = float(patch.mean()) - black_grey, float(match.mean()) - black_grey
            if min(levels) > _LEAST_GREY:
                found.append(levels[0] / levels[1])
    return found


def _found_at(patch: Grey, strip: Grey) -> tuple[int, int] | None:
    """Return row and column in the strip where the patch lies; None where that is in doubt."""
    score = np.asarray(cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED))
    y, x = (int(place) for place in np.unravel_index(int(np.argmax(score)), score.shape))
    best = float(score[y, x])
    rivals = score.copy()
    rivals[:, max(0, x - _PATCH_PX // 2) : x + _PATCH_PX // 2 + 1] = -1
    if best < _CLEAR or float(rivals.max()) > best - _UNIQUE:
        return None
    return y, x
