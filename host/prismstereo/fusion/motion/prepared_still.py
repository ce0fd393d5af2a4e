"""A still made ready for many frames: its objects, how far each of them reaches at full resolution, and its features."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.background import Background
from prismstereo.fusion.motion.change import UNEXPLAINED, ChangeMask, change_mask, filled
from prismstereo.fusion.motion.features import Features
from prismstereo.fusion.motion.likeness import SHADED, unlikeness
from prismstereo.fusion.motion.picture import HALF_STEP, grey, high_from_low, reduced, require_picture
from prismstereo_hw.errors import DataError

__all__ = ["BLURS_PX", "PreparedStill", "StillPart"]

Float = NDArray[np.float32]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]

BLURS_PX = (
    0.0,
    1.5,
)  # of the pictures with two pixels for one of the video: as they are, and for frames blurred by motion
_DARK = 4.0  # grey levels: a still whose brightest pixels are darker shows nothing
_ROOM_PX = 3  # video pixels around a part in which its outline is looked for
_RIM_PX = 1.5  # video pixels that an object is shown beyond its outline
_FEATHER_PX = 0.8  # still pixels


@dataclass(frozen=True, slots=True)
class StillPart:
    """One connected part of what the still shows before the background.

    `mask` (height, width) bool in video pixels; `features` once for every blur in `BLURS_PX`.
    """

    number: int
    mask: Mask
    features: tuple[Features, ...]


@dataclass(frozen=True, slots=True)
class PreparedStill:
    """`picture` (H, W[, 3]) uint8; `fine` the same with two pixels for one of the video; `change` against the background.

    `opacity` (H, W) uint8 is 255 on objects and on a rim around them, feathered. `background` (H, W[, 3]) uint8 is the
    background still in this still's place and light, or None.
    """

    picture: Picture
    fine: Picture
    change: ChangeMask
    parts: tuple[StillPart, ...]
    opacity: Picture
    background: Picture | None

    @classmethod
    def of(cls, picture: Picture, background: Background) -> PreparedStill:
        """Compare a still (H, W[, 3]) uint8, rectified, with the background; DataError for one that does not fit."""
        require_picture(picture, "the still")
        if picture.ndim != background.video.ndim:
            raise DataError(
                "the still and the background are not both grey, or both in colours: take them in the same way"
            )
        if background.still is not None and background.still.shape != picture.shape:
            raise DataError(
                f"the still is {picture.shape} but the background still {background.still.shape}: give one size"
            )
        if float(np.percentile(picture[::4, ::4], 99)) < _DARK:
            raise DataError("the still is black: its brightest parts are below 4 of 255; use another one")
        shape = background.video.shape
        change = change_mask(reduced(picture, background.grid, shape), background)
        fine = reduced(picture, background.grid, shape, HALF_STEP)
        behind = _lit_background(picture, background, change)
        parts = _parts(change.changed, grey(fine))
        return cls(picture, fine, change, parts, _opacity(picture, behind, change, background), behind)


def _parts(changed: Mask, fine: Float) -> tuple[StillPart, ...]:
    count, labels = cv2.connectedComponents(changed.astype(np.uint8), connectivity=8)
    parts = []
    for number in range(1, count):
        mask = labels == number
        where = cv2.resize(mask.astype(np.uint8), fine.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        features = tuple(Features.of(fine, mask=where, factor=HALF_STEP, blur_px=blur) for blur in BLURS_PX)
        parts.append(StillPart(number, mask, features))
    return tuple(parts)


def _lit_background(picture: Picture, background: Background, change: ChangeMask) -> Picture | None:
    if background.still is None:
        return None
    moved = background.still
    if not np.array_equal(change.pose, np.eye(3)):
        S = high_from_low(background.grid)
        M = S @ change.pose @ np.linalg.inv(S)
        size = picture.shape[1::-1]
        moved = np.asarray(
            cv2.warpPerspective(moved, M, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.uint8
        )
    return change.gain.applied_to_bytes(moved)


def _opacity(picture: Picture, behind: Picture | None, change: ChangeMask, background: Background) -> Picture:
    """Draw the outline of the objects: where still and background still differ, near where their small pictures do."""
    grid = background.grid
    size = picture.shape[1::-1]
    S = high_from_low(grid)[:2]
    opacity = np.zeros(picture.shape[:2], np.uint8)
    if not change.changed.any():
        return opacity
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _ROOM_PX + 1, 2 * _ROOM_PX + 1))
    changed = change.changed.astype(np.uint8)
    wide, core = cv2.dilate(changed, disc), cv2.erode(changed, disc)
    if behind is None:
        share = cv2.warpAffine(changed * np.uint8(255), S, size, flags=cv2.INTER_LINEAR)
        return np.asarray(np.where(share > 127, 255, 0), np.uint8)
    may, must = (cv2.warpAffine(m, S, size, flags=cv2.INTER_NEAREST) for m in (wide, core))
    for left, top, width, height in _boxes(np.asarray(may, np.uint8)):
        box = np.s_[top : top + height, left : left + width]
        found = unlikeness(
            picture[box].astype(np.float32), behind[box].astype(np.float32), SHADED,
            noise=change.noise, window=5, slack_px=0.15 * grid.scale_x,
        )  # fmt: skip
        outline = ((found > UNEXPLAINED) & (may[box] > 0)) | (must[box] > 0)
        opacity[box] = np.maximum(opacity[box], _smooth(outline, grid.scale_x))
    return opacity


def _boxes(mask: Picture) -> list[tuple[int, int, int, int]]:
    count, _, figures, _ = cv2.connectedComponentsWithStats(mask)
    return [(int(f[0]), int(f[1]), int(f[2]), int(f[3])) for f in figures[1:count]]


def _smooth(outline: Mask, scale: float) -> Picture:
    reach = 2 * math.ceil(scale) + 1
    close = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    whole = cv2.copyMakeBorder(outline.astype(np.uint8), reach, reach, reach, reach, cv2.BORDER_CONSTANT)
    whole = filled(cv2.morphologyEx(whole, cv2.MORPH_CLOSE, close) > 0).astype(np.uint8)
    whole = cv2.morphologyEx(whole, cv2.MORPH_OPEN, close)[reach:-reach, reach:-reach]
    # a rim too wide shows ground where ground is, and the edge where it is; one too narrow would move the edge
    rim = 2 * round(_RIM_PX * scale) + 1
    wide = cv2.dilate(
        np.ascontiguousarray(whole) * np.uint8(255), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (rim, rim))
    )
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), _FEATHER_PX), np.uint8)
