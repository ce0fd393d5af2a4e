"""The same points found in both views of raw frames, after the rectification that the rig file promises.

Unlike the matchers of the device this looks for a partner anywhere, not on the same row alone: where it is found says how
the unit differs from its drawing. What the two pictures show around a pair also tells which of them is blurred or dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, RectifiedView, rectification
from prismstereo_calibration.uncalibrated.partners import partners
from prismstereo_device.rectify import RectifiedPair, Rectifier
from prismstereo_device.split import split
from prismstereo_hw.errors import ImageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig

__all__ = ["MatchedRows", "matched_rows"]

Array = NDArray[np.float64]

_FEATURES = 1500  # of each picture
_MOST_TURN = 0.12  # of the focal length: farther off its row, a partner is a mistake or the rig file another unit's
_LEAST_PAIRS = 16
_PATCH = 25  # pixels a side: what is compared of the two pictures around a pair


@dataclass(frozen=True, slots=True)
class MatchedRows:
    """Pairs of points of both views and how the pictures compare there; N pairs of all frames together.

    `left_px`, `right_px` (N, 2): in the nominally rectified pictures. `raw_left_px`, `raw_right_px` (N, 2): in the raw frame.
    `sharpness`, `brightness` (N,): the left picture's over the right one's around each pair.
    """

    rectification: Rectification
    left_px: Array
    right_px: Array
    raw_left_px: Array
    raw_right_px: Array
    sharpness: Array
    brightness: Array

    @property
    def count(self) -> int:
        """How many pairs there are."""
        return len(self.left_px)


def matched_rows(frames: Sequence[RawFrame], rig: Rig) -> MatchedRows:
    """Match both views of one or more frames of a unit, rectified as its rig file promises.

    `CalibrationError` for a frame of another size than the rig's video mode; `ImageError` where a view shows no texture, or
    nothing that the other one shows too.
    """
    if not frames:
        raise ImageError("0 frames: nothing can be aligned without a picture, give one or more")
    calibration = Calibration.nominal(rig)
    for frame in frames:
        calibration.require_frame(frame)
    how = rectification(calibration)
    rectifier = Rectifier(how)
    pairs = [rectifier.rectify(split(frame, rig.views)) for frame in frames]
    found = [partners(pair.left, pair.right, pair.left_seen, pair.right_seen, features=_FEATURES) for pair in pairs]
    left, right = (np.concatenate([points[side] for points in found]) for side in (0, 1))
    keep = _consistent(left, right, _MOST_TURN * how.focal_px)
    if np.count_nonzero(keep) < _LEAST_PAIRS:
        raise ImageError(
            f"{np.count_nonzero(keep)} points are found in both views, and {_LEAST_PAIRS} are needed: let the rig look at "
            "textured things within its range, focus it, and check that the rig file is this unit's"
        )
    looks = np.concatenate([_looks(pair, *points) for pair, points in zip(pairs, found, strict=True)])[keep]
    left, right = left[keep], right[keep]
    return MatchedRows(
        rectification=how,
        left_px=left,
        right_px=right,
        raw_left_px=_raw(how, how.left, left),
        raw_right_px=_raw(how, how.right, right),
        sharpness=looks[:, 0],
        brightness=looks[:, 1],
    )


def _consistent(left: Array, right: Array, most_px: float) -> NDArray[np.bool_]:
    """Tell which pairs lie about as far off their rows as most others do, a small turn of the views allowed for."""
    off = right[:, 1] - left[:, 1]
    near = np.abs(off) < most_px
    if not near.any():
        return near
    middle = float(np.median(off[near]))
    spread = 1.4826 * float(np.median(np.abs(off[near] - middle)))
    return np.asarray(near & (np.abs(off - middle) < max(3.0, 5 * spread)))


def _raw(how: Rectification, side: RectifiedView, rectified: Array) -> Array:
    """Take rectified pixels (N, 2) of a view to the raw frame."""
    points = how.points_at(rectified, np.full(len(rectified), how.exact_at), side)
    upright = side.camera.project(points)
    return side.view.raw_from_upright(upright, how.frame_width, how.frame_height)


def _looks(pair: RectifiedPair, left: Array, right: Array) -> Array:
    """Return sharpness and brightness (N, 2) of the left picture over the right one's around each pair of points."""
    one, other = _look(pair.left, left), _look(pair.right, right)
    return one / other


def _look(picture: NDArray[np.uint8], points: Array) -> Array:
    """Return the variance of the Laplacian by that of the picture, and the mean grey level, around points: (N, 2)."""
    grey, size = picture.astype(np.float64), (_PATCH, _PATCH)
    mean = cv2.boxFilter(grey, -1, size)
    variance = cv2.boxFilter(grey * grey, -1, size) - mean * mean
    bent = cv2.boxFilter(cv2.Laplacian(grey, cv2.CV_64F) ** 2, -1, size)
    columns, rows = np.rint(points).astype(int).T
    sharp = bent[rows, columns] / np.maximum(variance[rows, columns], 1.0)
    return np.stack([np.maximum(sharp, 1e-6), np.maximum(mean[rows, columns], 1.0)], axis=1)
