"""One look at the optics: what a single frame tells of them, whatever the scene.

A few hundred well textured points of the left view are looked for in the right one, some rows up and down as well: how far off
their row they are found tells whether the views still stand as they were calibrated, and what both pictures show around
them tells which is darker or blurred. The scene itself drops out, since both views see the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.seam import find_seam
from prismstereo_device.rectify import RectifiedPair
from prismstereo_hw.errors import ImageError

__all__ = ["Look", "take_look"]

Picture = NDArray[np.uint8]

_POINTS = 160
_APART_PX = 12
_PATCH = 8  # half a side, pixels
_ROWS = 6  # up and down: farther off, a unit has to be calibrated anew anyway
_LEAST_LIKENESS = 0.85
_SECOND = 0.03  # by which the best place must beat any that is not next to it
_LEAST_PAIRS = 12


@dataclass(frozen=True, slots=True)
class Look:
    """What one frame tells; NaN where it tells nothing.

    `pairs`: points found in both views. `vertical_px`: how much lower the right view shows them, in the middle of the picture;
    `vertical_slope_px`: how much that grows from its left rim to its right one. `brightness_ratio`, `sharpness_ratio`: left
    over right. `left_grey`, `right_grey`: mean level of each view, `left_texture`, `right_texture`: root mean square step
    between neighbouring pixels, grey levels. `seam_px`: the seam's column in the raw frame.
    """

    pairs: int
    vertical_px: float
    vertical_slope_px: float
    brightness_ratio: float
    sharpness_ratio: float
    left_grey: float
    right_grey: float
    left_texture: float
    right_texture: float
    seam_px: float


def take_look(raw: Picture, pair: RectifiedPair, expected_seam_px: float | None = None) -> Look:
    """Look at a raw frame (height, width[, 3]) and its rectified pair; some 50 ms, for a thread apart from the frames'."""
    found = _pairs(pair)
    vertical, slope = _vertical(found, pair.left.shape[1])
    enough = len(found) >= _LEAST_PAIRS
    brightness, sharpness = (float(np.median(found[:, column])) if enough else math.nan for column in (2, 3))
    left_grey, left_texture = _light(pair.left, pair.left_seen)
    right_grey, right_texture = _light(pair.right, pair.right_seen)
    return Look(
        len(found), vertical, slope, brightness, sharpness, left_grey, right_grey, left_texture, right_texture,
        _seam(raw, expected_seam_px),
    )  # fmt: skip


def _seam(raw: Picture, expected_px: float | None) -> float:
    try:
        return find_seam([raw], expected_px).column_px
    except ImageError:
        return math.nan


def _light(picture: Picture, seen: NDArray[np.bool_] | None) -> tuple[float, float]:
    """Return mean level and root mean square step to the right neighbour, where the view shows anything."""
    mask = np.ones(picture.shape, np.bool_) if seen is None else seen
    both = mask[:, 1:] & mask[:, :-1]
    if not both.any():
        return math.nan, math.nan
    steps = np.diff(picture.astype(np.float32), axis=1)[both]
    return float(picture[mask].mean()), float(np.sqrt(np.mean(steps * steps)))


def _pairs(pair: RectifiedPair) -> NDArray[np.float64]:
    """Return, for each point found in both views: column, rows off, brightness ratio, sharpness ratio."""
    mask = None if pair.left_seen is None else pair.left_seen.astype(np.uint8)
    corners: Any = cv2.goodFeaturesToTrack(pair.left, _POINTS, 0.02, _APART_PX, mask=mask)  # None in a blank picture
    points = np.rint(np.reshape([] if corners is None else corners, (-1, 2))).astype(int)
    found = [looked for x, y in points if (looked := _partner(pair, int(x), int(y))) is not None]
    return np.array(found, np.float64).reshape(-1, 4)


def _partner(pair: RectifiedPair, x: int, y: int) -> tuple[float, float, float, float] | None:
    height, width = pair.left.shape
    top, bottom, reach = y - _PATCH - _ROWS, y + _PATCH + _ROWS + 1, max(_PATCH, x - pair.window.labels)
    if top < 0 or bottom > height or x + _PATCH + 1 > width or x - _PATCH < reach - _PATCH:
        return None
    patch = pair.left[y - _PATCH : y + _PATCH + 1, x - _PATCH : x + _PATCH + 1]
    strip = pair.right[top:bottom, reach - _PATCH : x + _PATCH + 1]
    if patch.shape != (2 * _PATCH + 1,) * 2 or strip.shape[1] < patch.shape[1]:
        return None
    likeness = cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED)
    _, best, _, (column, row) = cv2.minMaxLoc(likeness)
    if best < _LEAST_LIKENESS or row in (0, likeness.shape[0] - 1):
        return None
    rest = likeness.copy()
    rest[:, max(0, column - 3) : column + 4] = -1
    if float(rest.max()) > best - _SECOND:
        return None
    above, here, below = (float(likeness[row + step, column]) for step in (-1, 0, 1))
    bend = above - 2 * here + below
    part = 0.5 * (above - below) / bend if bend < 0 else 0.0
    other = strip[row : row + 2 * _PATCH + 1, column : column + 2 * _PATCH + 1]
    return x, row + part - _ROWS, *_compared(patch, other)


def _compared(left: Picture, right: Picture) -> tuple[float, float]:
    """Return brightness and sharpness of one patch over the other's; sharpness is what a blur would take, contrast apart."""
    means = [max(float(patch.mean()), 1.0) for patch in (left, right)]
    fine = [_fine(patch) for patch in (left, right)]
    return means[0] / means[1], fine[0] / fine[1]


def _fine(patch: Picture) -> float:
    grey = patch.astype(np.float32)
    rest = grey - cv2.GaussianBlur(grey, (0, 0), 1.0)
    return max(float(rest.std()), 1e-3) / max(float(grey.std()), 1e-3)


def _vertical(found: NDArray[np.float64], width: int) -> tuple[float, float]:
    """Return rows off in the middle, and their growth from the left rim to the right one, by Tukey's weights."""
    if len(found) < _LEAST_PAIRS:
        return math.nan, math.nan
    aside = found[:, 0] / width - 0.5
    terms = np.stack([np.ones_like(aside), aside], axis=1)
    weights: NDArray[np.float64] = np.ones(len(found))
    line: NDArray[np.float64] = np.zeros(2)
    for _ in range(8):
        line = np.asarray(np.linalg.lstsq(terms * weights[:, None], found[:, 1] * weights, rcond=None)[0], np.float64)
        rest = found[:, 1] - terms @ line
        spread = 1.4826 * float(np.median(np.abs(rest))) + 1e-3
        weights = np.maximum(1 - (rest / (4.685 * spread)) ** 2, 0)
    return float(line[0]), float(line[1])
