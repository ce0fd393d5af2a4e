"""The seam: where the two views meet in a raw frame, found in the picture and nowhere else.

The prism's apex divides the frame. A narrow pupil leaves a step there, a wide one a band in which both views lie over each
other. The step is found as the column (a slanted one, if need be) where neighbours differ in every row, the band by its
contrast: where shares w and 1 - w of two unrelated pictures add up, w^2 + (1 - w)^2 of their variance is left, half of it
in the middle. The seam's column is NOT the principal point: it says how the lens stands to the prism.

Pixels. (0, 0) is the centre of the top-left pixel of the raw frame. Views above each other have no seam of this kind.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import ImageError

__all__ = ["OWN_LIGHT", "Seam", "find_seam"]

Array = NDArray[np.float64]

OWN_LIGHT = 0.9  # a column with a smaller share of its own view's light counts as blended
_REACH = 0.15  # of the frame's width, either side of the expected column: how far the seam is looked for
_SPAN = 0.28  # of the frame's width, either side: what the band's surroundings are judged by
_MOST_SLANT_DEG = 3.0
_SLANTS_DEG = np.linspace(-_MOST_SLANT_DEG, _MOST_SLANT_DEG, 61)
_BLOCK_ROWS = 24  # rows that are shifted together when a slant is tried
_CLEAR_STEP = 6.0  # a step must stand out by so many deviations of the other columns
_SURE_STEP = 1.5  # times as clear as it must be: below, a band may explain the picture better
_CLEAR_BAND = 1.25  # the band must explain so much more of the contrast than a straight line
_LEAST_CONTRAST = 2.0  # grey levels between neighbours, root mean square: below, it is a blank wall and noise
_WIDTHS = 22


@dataclass(frozen=True, slots=True)
class Seam:
    """The seam of a raw frame.

    `column_px`: where it crosses the middle row. `slant_deg`: how far it leans to the right going down; NaN for a band
    so wide that its slant cannot be told. `width_px`: how many columns have less than nine tenths of their own view's
    light; 0 for a step.
    `clearness`: how far it stands out, 1 being just enough.
    """

    column_px: float
    slant_deg: float
    width_px: float
    clearness: float

    def column_at(self, row: float, height: int) -> float:
        """Return the column where the seam crosses a row of a frame of that height."""
        lean = 0.0 if math.isnan(self.slant_deg) else math.tan(math.radians(self.slant_deg))
        return self.column_px + (row - (height - 1) / 2) * lean


def find_seam(frames: Sequence[NDArray[np.uint8]], expected_px: float | None = None) -> Seam:
    """Find the seam in raw frames of one camera, (height, width[, 3]) uint8 of one size; more frames make it surer.

    It is looked for within 15 % of the frame's width around `expected_px` (default: the middle). `ImageError` for no frame,
    sizes that differ, and a scene that shows no seam: a blank wall.
    """
    pictures = [_grey(frame) for frame in frames]
    if not pictures:
        raise ImageError("0 frames: the seam is found in pictures, give one or more")
    sizes = {picture.shape for picture in pictures}
    if len(sizes) > 1:
        raise ImageError(
            f"frames of {len(sizes)} sizes: the seam belongs to one camera and mode, give frames of one size"
        )
    height, width = pictures[0].shape
    if width < 64 or height < 48:
        raise ImageError(f"frames of {width}x{height}: a seam is found in raw frames of at least 64x48 pixels")
    expected = (width - 1) / 2 if expected_px is None else expected_px
    steps = [np.abs(np.diff(picture, axis=1)) for picture in pictures]
    contrast = math.sqrt(float(np.mean([np.mean(_near(step, expected) ** 2) for step in steps])))
    if contrast < _LEAST_CONTRAST:
        raise ImageError(
            f"neighbouring pixels differ by {contrast:.1f} grey levels: a blank scene shows no seam, let the rig look at "
            "something with texture in all of its field"
        )
    found = _step(steps, expected)
    if found is None or found.clearness < _SURE_STEP:
        found = max(found, _band(steps, expected), key=lambda seam: seam.clearness if seam else 0.0)
    if found is None:
        raise ImageError(
            f"no seam within {_REACH * width:.0f} columns of column {expected:.0f}: let the rig look at texture in all of its "
            "field, give more frames, or check that the rig file is this unit's"
        )
    return found


def _grey(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    pixels = np.ascontiguousarray(pixels)
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels
    return np.asarray(grey, np.float32)


def _near(columns: NDArray[np.float32], expected: float) -> NDArray[np.float32]:
    reach = _SPAN * columns.shape[1]
    return columns[:, max(0, int(expected - reach)) : int(expected + reach) + 1]


def _blocks(rows: NDArray[np.float32]) -> tuple[Array, Array]:
    """Average groups of rows: (blocks, columns), and the middle row of each block, counted from the frame's middle."""
    height = rows.shape[0]
    edges = np.linspace(0, height, max(2, height // _BLOCK_ROWS) + 1).astype(int)
    means = np.stack([rows[a:b].mean(axis=0, dtype=np.float64) for a, b in pairwise(edges)])
    return means, (edges[:-1] + edges[1:] - 1) / 2 - (height - 1) / 2


def _profiles(rows: NDArray[np.float32], slants_deg: Array) -> Array:
    """Average rows along slanted columns: (slants, columns), a column named by where it crosses the middle row.

    Of each column only the lower half of its blocks of rows counts: what stands out in half of the height alone is no seam.
    """
    means, offsets = _blocks(rows)
    columns, half = np.arange(means.shape[1], dtype=float), len(means) // 2

    def along(slant_deg: float) -> Array:
        lean = math.tan(math.radians(slant_deg))
        moved = [np.interp(columns + offset * lean, columns, mean) for mean, offset in zip(means, offsets, strict=True)]
        return np.asarray(np.partition(np.stack(moved), half - 1, axis=0)[:half].mean(axis=0))

    return np.stack([along(slant) for slant in slants_deg])


def _step(steps: Sequence[NDArray[np.float32]], expected: float) -> Seam | None:
    """Find a sharp seam: the slanted column where neighbours differ in all rows; None where no column stands out.

    Single strong edges of the scene are capped; one as high as the frame may still be taken for the seam.
    """
    caps = [float(np.percentile(_near(step, expected), 95)) + 1 for step in steps]
    capped = np.stack([np.minimum(step, cap) for step, cap in zip(steps, caps, strict=True)]).mean(axis=0)
    width = capped.shape[1] + 1
    first, last = max(2, int(expected - _REACH * width)), min(width - 4, int(expected + _REACH * width))
    coarse = [_standing_out(profile)[first:last] for profile in _profiles(capped, _SLANTS_DEG)]
    slant = float(_SLANTS_DEG[int(np.argmax([clear.max() for clear in coarse]))])
    fine_deg = slant + np.linspace(-0.1, 0.1, 21)
    profiles = _profiles(capped, fine_deg)[:, first:last]
    best = int(np.argmax(profiles.max(axis=1)))
    clearness = _standing_out(_profiles(capped, fine_deg[best : best + 1])[0])[first:last]
    peak, profile = int(np.argmax(clearness)), profiles[best]
    clear = float(clearness[peak]) / _CLEAR_STEP
    if clear < 1:
        return None
    around = np.arange(max(0, peak - 2), min(len(profile), peak + 3))
    excess = np.maximum(profile[around] - np.median(profile[max(0, peak - 12) : peak + 13]), 0) ** 2
    column = first + float(np.sum(around * excess) / np.sum(excess)) + 0.5  # a difference lies between two pixels
    return Seam(column, float(fine_deg[best]), 0.0, clear)


def _standing_out(profile: Array) -> Array:
    """Return by how many deviations each column stands above its neighbours on both sides, the livelier side counting."""
    side = max(8, len(profile) // 32)
    padded = np.pad(profile, side, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, side - 2)
    middle = np.median(windows, axis=1)
    spread = 1.4826 * np.median(np.abs(windows - middle[:, None]), axis=1) + 1e-3
    spread = np.maximum(spread, np.median(spread))  # a few columns that happen to agree prove nothing
    columns = np.arange(len(profile))
    before, after = columns, columns + side + 3  # windows that end, or begin, three columns from the one in question
    level = np.maximum(middle[before], middle[after])
    return np.asarray((profile - level) / np.maximum(spread[before], spread[after]))


def _own_share(u: Array) -> Array:
    """Return the share of a round pupil on one side of a chord at u = -1 .. 1 of its radius."""
    u = np.clip(u, -1, 1)
    return np.asarray(0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / math.pi)


def _band(steps: Sequence[NDArray[np.float32]], expected: float) -> Seam | None:
    """Find a blended seam by its contrast; None where a band explains the contrast no better than a straight line."""
    width = steps[0].shape[1] + 1
    energy = np.mean(
        [np.minimum(step, np.percentile(_near(step, expected), 98)) ** 2 for step in steps], axis=0
    ).astype(np.float32)
    column, full_width, gain = _fit_band(energy.mean(axis=0, dtype=np.float64), expected, width)
    if gain < _CLEAR_BAND:
        return None
    slant = _band_slant(energy, column, full_width)
    own = np.linspace(0, 1, 2001)
    blended = full_width * float(own[np.searchsorted(_own_share(own), OWN_LIGHT)])
    return Seam(column + 0.5, slant, blended, gain / _CLEAR_BAND)


def _fit_band(profile: Array, expected: float, width: int) -> tuple[float, float, float]:
    """Return middle and full width of the band that explains a profile of contrast best, and how much better than none."""
    span = np.arange(max(4, int(expected - _SPAN * width)), min(width - 5, int(expected + _SPAN * width)), dtype=float)
    levels = np.log(np.maximum(profile[span.astype(int)], 1e-6))
    slope = (span - expected) / width
    base = np.linalg.qr(np.stack([np.ones_like(span), slope, slope**2], axis=1))[0]

    def misfit(values: Array) -> Array:
        """Return the sum of squares that a parabola leaves of values (..., N), outliers capped."""
        rest = values - (values @ base) @ base.T
        return np.asarray(np.sum(np.minimum(rest**2, 1.0), axis=-1))

    side = len(span) // 3  # the views need not be equally lively: what lies far from the seam tells the proportion
    jump = float(np.exp(np.median(levels[-side:]) - np.median(levels[:side])))

    def best(middles: Array, widths: Array) -> tuple[float, float, float]:
        """Return the least misfit, and the middle and the width that give it."""
        found = (math.inf, expected, 0.0)
        for full in widths:
            share = _own_share(2 * (span - middles[:, None]) / full)
            for ratio in (1.0, jump):
                left = misfit(levels - np.log(share**2 * ratio + (1 - share) ** 2))
                at = int(np.argmin(left))
                found = min(found, (float(left[at]), float(middles[at]), float(full)))
        return found

    step, reach = max(1.0, width / 640), _REACH * width
    _, middle, full = best(
        np.arange(expected - reach, expected + reach, step), width * np.geomspace(0.012, 0.4, _WIDTHS)
    )
    left, middle, full = best(middle + step * np.linspace(-1, 1, 17), full * np.linspace(0.85, 1.15, 13))
    return middle, full, float(misfit(levels)) / max(left, 1e-12)


def _band_slant(energy: NDArray[np.float32], middle: float, full: float) -> float:
    """Return how a band of known middle and width leans, by its middles in the upper and the lower half; NaN if it is wide."""
    height, width = energy.shape
    if (
        full > 0.08 * height
    ):  # a half tells the middle to a tenth of the width: that much lean would be a degree and more
        return math.nan
    upper, lower = (
        _fit_band(rows.mean(axis=0, dtype=np.float64), middle, width)[0]
        for rows in (energy[: height // 2], energy[height // 2 :])
    )
    return math.degrees(math.atan((lower - upper) / (height / 2)))
