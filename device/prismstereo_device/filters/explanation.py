"""The reason of every unmatched pixel, as well as calibration, picture, matcher and search range can tell it.

Known once per calibration: `outside`, `seam`, `vignetted`. Measured in the left picture: `saturated`, `dark`, `weak_texture`.
Measured in both: `too_near` and `too_far`, where disparities beyond the search explain the pictures clearly better than those
that were searched. Said by the matcher: `occluded`, `ambiguous`, `filtered`.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters.beyond_range import BLOCK, beyond_range
from prismstereo_device.filters.explanation_kernels import decide, spread
from prismstereo_device.reasons import Reason
from prismstereo_hw.errors import ImageError

__all__ = ["explained"]

Grey = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_WINDOW_PX = 9  # what a matcher looks at, roughly
_SATURATED, _DARK = 250, 8  # grey levels
_LARGEST_STEP = 15  # between the neighbours of a pixel, squared at most 225: fits into a byte
_LEAST_STEP_SQUARED = 16.0  # mean over a window, grey levels: 2 per pixel, see `match.subpixel`
_MOST_NOISE_SQUARED = 48.0  # with more, it is the picture's texture that is everywhere
_FLATTEST = 0.05  # share of the picture that shows noise alone
_EVERY_PX = 8
_LEAST_SHARE = 0.005  # of the picture: with less to explain, nothing is looked for beyond the range

# A filter knew what it took away, and the calibration what it leaves out: nothing that is measured here says more.
_CERTAIN = np.zeros(256, np.bool_)
_CERTAIN[
    [
        Reason.OUTSIDE, Reason.SEAM, Reason.VIGNETTED, Reason.TOO_NEAR, Reason.TOO_FAR, Reason.FILTERED,
        Reason.LOST_ON_LINE,
    ]
] = True  # fmt: skip


def explained(
    disparity: DisparityMap, left: Grey, right: Grey, left_seen: Mask | None = None, static: Grey | None = None
) -> DisparityMap:
    """Give every unmatched pixel its reason, see `reasons.Reason`; matched ones have `MATCHED`.

    `left` and `right` are the grey rectified pictures (height, width) uint8 that were matched, `left_seen` (height, width) bool
    tells where the left one shows anything, and `static` (height, width) uint8 holds the calibration's codes of the left
    rectified picture (`rectified_reasons`). `ImageError` for sizes that differ.
    """
    _check(disparity, left, right, left_seen, static)
    shape = left.shape
    told = np.zeros(shape, np.uint8) if disparity.reasons is None else disparity.reasons
    seen = np.ones(shape, np.bool_) if left_seen is None else left_seen
    window = (_WINDOW_PX, _WINDOW_PX)
    clipped = cv2.blur(cv2.threshold(left, _SATURATED - 1, 255, cv2.THRESH_BINARY)[1], window)
    power = _power(left)
    reasons, unexplained = np.empty(shape, np.uint8), np.zeros(shape, np.bool_)
    count = decide(
        np.ascontiguousarray(disparity.disparity_px, np.float32), told, _CERTAIN, seen,
        np.zeros(shape, np.uint8) if static is None else static, np.asarray(clipped, np.uint8),
        np.asarray(cv2.blur(left, window), np.uint8), _DARK, power, _least_power(power, left_seen), reasons, unexplained,
    )  # fmt: skip
    if count > _LEAST_SHARE * reasons.size:
        spread(beyond_range(left, right, disparity.window), *BLOCK, unexplained, reasons)
    return replace(disparity, reasons=reasons)


def _power(left: Grey) -> Grey:
    """Return the mean squared step along the row over each pixel's window, in squared grey levels per two pixels."""
    step = np.zeros_like(left)
    if left.shape[1] > 2:
        step[:, 1:-1] = cv2.absdiff(left[:, 2:], left[:, :-2])
    squares = np.minimum(np.arange(256), _LARGEST_STEP).astype(np.uint8) ** 2
    return np.asarray(cv2.blur(cv2.LUT(step, squares), (_WINDOW_PX, _WINDOW_PX)), np.uint8)


def _least_power(power: Grey, left_seen: Mask | None) -> float:
    """Return the mean squared step that is texture and no noise: noise alone is what the flattest parts show."""
    sample = power[::_EVERY_PX, ::_EVERY_PX]
    if left_seen is not None:
        sample = sample[left_seen[::_EVERY_PX, ::_EVERY_PX]]
    noise = float(np.quantile(sample.astype(np.float32), _FLATTEST)) if sample.size else 0.0
    return float(np.clip(2 * noise, _LEAST_STEP_SQUARED, _MOST_NOISE_SQUARED))


def _check(disparity: DisparityMap, left: Grey, right: Grey, left_seen: Mask | None, static: Grey | None) -> None:
    shape = disparity.disparity_px.shape
    for name, given, kind in (
        ("left picture", left, np.uint8), ("right picture", right, np.uint8), ("mask", left_seen, np.bool_),
        ("static mask", static, np.uint8),
    ):  # fmt: skip
        if given is not None and (given.shape != shape or given.dtype != kind):
            raise ImageError(
                f"the {name} is {given.dtype} {given.shape}, but the disparity map {shape}: give {np.dtype(kind)} of its size"
            )
