"""The guide for one video frame: what a still would have shown at that instant, and the video itself where nobody knows.

From back to front: the background still; every object of the nearest still, shown where its model says; the enlarged video
frame wherever the result, seen at the video's resolution, is not what the frame shows. Whatever went wrong before, that last
step finds it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.flags import Flag
from prismstereo.fusion.motion.background import Background
from prismstereo.fusion.motion.change import UNEXPLAINED, ChangeMask, change_mask
from prismstereo.fusion.motion.gain import Gain
from prismstereo.fusion.motion.likeness import LightRange, unlikeness
from prismstereo.fusion.motion.models import Relief
from prismstereo.fusion.motion.objects import MovingObject, objects_in
from prismstereo.fusion.motion.picture import channels, high_from_low, reduced, require_picture
from prismstereo.fusion.motion.prepared_still import PreparedStill
from prismstereo.fusion.motion.warp import places_in_still, shown
from prismstereo.fusion.upsampling.grid import Grid
from prismstereo_hw.errors import DataError

__all__ = ["GuideForFrame", "guide_for"]

Float = NDArray[np.float32]
Mask = NDArray[np.bool_]
Matrix = NDArray[np.float64]
Picture = NDArray[np.uint8]
_ANY_LIGHT = LightRange(0.3, 3.0)  # the still and the frame may each have the shadow
_GROWN = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
_AROUND_STEPS = 2  # of two video pixels each
_HALF = 128


@dataclass(frozen=True, slots=True)
class GuideForFrame:
    """`picture` (H, W[, 3]) uint8 is the guide; `flags` (H, W) uint8: `Flag.GUIDE_IS_VIDEO` and `Flag.MOVED`.

    `objects` are those of the still, followed or not; `moving` (height, width) bool is what of the frame is not background, and
    `from_video` (height, width) bool where the video frame itself is the guide, both in video pixels.
    """

    picture: Picture
    flags: Picture
    objects: tuple[MovingObject, ...]
    moving: Mask
    from_video: Mask


def guide_for(
    frame: Picture, still: PreparedStill | None, background: Background, *, relief: Relief | None = None,
    size: tuple[int, ...] | None = None,
) -> GuideForFrame:  # fmt: skip
    """Make the guide for a rectified frame (height, width[, 3]) uint8 from the still nearest in time and the background.

    `relief` is what the frame's own disparity tells of depth: with it, things with relief can be followed. Without a still,
    or a background still, the video is the guide where nothing else is; then `size` (H, W) is that of the guide. Raises
    DataError for pictures that do not go together.
    """
    require_picture(frame, "the frame")
    if frame.shape != background.video.shape:
        raise DataError(f"the frame is {frame.shape} but the background {background.video.shape}: give one camera mode")
    change = change_mask(frame, background)
    objects = [] if still is None else objects_in(frame, change, still, relief)
    claims = _claims(objects, change)
    high = _size(still, background, size)
    S = high_from_low(background.grid)
    canvas = _Canvas(*_at_rest(frame, still, background, change, high), np.zeros(high, np.uint8))
    if still is not None:
        for number, found in enumerate(objects):
            if found.trusted:
                _paint(canvas, found, claims == number, still, background.grid)
    moving = (change.changed & (claims == _NOBODY)) | (claims >= 0)
    wrong = _wrong(frame, canvas, objects, claims, change, background.grid) | _cuts(objects, claims)
    return _with_video(frame, canvas, wrong, tuple(objects), moving, S)


_NOBODY = -1


@dataclass(frozen=True, slots=True)
class _Canvas:
    """The guide under work, in the light of the still: `unknown` and `moved` (H, W) uint8 are 0 to 255."""

    picture: Picture
    unknown: Picture
    moved: Picture


def _size(still: PreparedStill | None, background: Background, size: tuple[int, ...] | None) -> tuple[int, int]:
    known = still.picture if still is not None else background.still
    if known is not None:
        return known.shape[0], known.shape[1]
    if size is None:
        raise DataError("neither a still nor a background still: say the size of the guide")
    return size[0], size[1]


def _claims(objects: list[MovingObject], change: ChangeMask) -> NDArray[np.int16]:
    """Say which object each video pixel belongs to: the one that explains it best; -1 for none."""
    claims = np.full(change.changed.shape, _NOBODY, np.int16)
    best = np.full(change.changed.shape, np.inf, np.float32)
    for number, found in enumerate(objects):
        if found.evidence is None:
            continue
        cut = found.evidence.box.cut
        unlike = cv2.GaussianBlur(found.evidence.unlike, (0, 0), 1.0)
        wins = found.in_frame[cut] & (unlike < best[cut])
        claims[cut][wins] = number
        best[cut][wins] = unlike[wins]
    return claims


def _at_rest(
    frame: Picture, still: PreparedStill | None, background: Background, change: ChangeMask, high: tuple[int, int]
) -> tuple[Picture, Picture]:
    """Return the picture of what is at rest as the frame's camera stood, and where there is none (H, W) uint8, 255 unknown."""
    S = high_from_low(background.grid)
    shape = (*high, 3) if frame.ndim == 3 else high
    unknown: NDArray[np.uint8] = np.zeros(high, np.uint8)
    picture, pose = background.still, change.pose
    if still is None and picture is None:
        return np.zeros(shape, np.uint8), np.full(high, 255, np.uint8)
    if still is not None:
        pose = change.pose @ np.linalg.inv(still.change.pose)
        picture = still.background
        if picture is None:
            grown = np.ones((2 * round(background.grid.scale_x) + 1,) * 2, np.uint8)
            picture, unknown = still.picture, np.asarray(cv2.dilate(still.opacity, grown), np.uint8)
    assert picture is not None
    if np.allclose(pose, np.eye(3), atol=1e-12):
        return picture.copy(), unknown
    M = S @ pose @ np.linalg.inv(S)
    moved = cv2.warpPerspective(picture, M, high[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    lost = cv2.warpPerspective(
        unknown, M, high[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255
    )
    return np.asarray(moved, np.uint8), np.asarray(lost, np.uint8)


def _paint(canvas: _Canvas, found: MovingObject, claimed: Mask, still: PreparedStill, grid: Grid) -> None:
    """Show an object on the canvas where it is seen in the frame: its own outline, cut where something hides it."""
    evidence = found.evidence
    assert evidence is not None
    box = evidence.box
    S = high_from_low(grid)
    height, width = canvas.moved.shape
    low, top = (_high(box.left, grid.scale_x, grid.shift_x_px), _high(box.top, grid.scale_y, grid.shift_y_px))
    right, bottom = (_high(box.right, grid.scale_x, grid.shift_x_px), _high(box.bottom, grid.scale_y, grid.shift_y_px))
    left, top, right, bottom = max(low, 0), max(top, 0), min(right, width), min(bottom, height)
    if right - left < 2 or bottom - top < 2:
        return
    to = (
        np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]])
        @ S
        @ np.array([[1, 0, box.left], [0, 1, box.top], [0, 0, 1.0]])
    )
    size = (right - left, bottom - top)
    places = places_in_still(evidence.model, box)
    skin = shown(still.picture, places, S, (to, size), cv2.INTER_CUBIC)
    opacity = shown(_opacity_of(found, still, grid), places, S, (to, size), cv2.INTER_LINEAR)
    barred = (evidence.visible & ~claimed[box.cut]).astype(np.uint8) * np.uint8(255)
    seen = 255 - cv2.warpAffine(barred, to[:2], size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    share = opacity.astype(np.float32) * seen.astype(np.float32) * np.float32(1 / 255**2)
    where = np.s_[top:bottom, left:right]
    canvas.picture[where] = _mixed(canvas.picture[where], skin, share)
    rest = canvas.unknown[where] * (1 - share)
    canvas.unknown[where] = np.rint(rest).astype(np.uint8)
    canvas.moved[where] = np.maximum(canvas.moved[where], np.rint(255 * share).astype(np.uint8))


def _opacity_of(found: MovingObject, still: PreparedStill, grid: Grid) -> Picture:
    """Return the outlines in the still of one object alone, (H, W) uint8."""
    near = cv2.dilate(found.in_still.astype(np.uint8), np.ones((7, 7), np.uint8))
    near = cv2.warpAffine(near, high_from_low(grid)[:2], still.opacity.shape[::-1], flags=cv2.INTER_NEAREST)
    return np.asarray(still.opacity * near, np.uint8)


def _high(low: int, scale: float, shift_px: float) -> int:
    """Return the first still pixel of a video pixel."""
    return int(np.ceil(low * scale + shift_px - 1e-9))


def _mixed(under: Picture, over: Picture | Float, share: Float) -> Picture:
    weight = share if under.ndim == 2 else share[..., None]
    return np.rint(under + weight * (over.astype(np.float32) - under)).astype(np.uint8)


def _wrong(
    frame: Picture,
    canvas: _Canvas,
    objects: list[MovingObject],
    claims: NDArray[np.int16],
    change: ChangeMask,
    grid: Grid,
) -> Mask:
    """Tell which video pixels the guide does not explain, as the video would show it."""
    seen = channels(reduced(canvas.picture, grid, frame.shape)).copy()
    for number, found in enumerate(objects):
        if found.evidence is not None and found.evidence.streak.length_px:
            cut = found.evidence.box.cut
            near = cv2.dilate((claims[cut] == number).astype(np.uint8), _GROWN) > 0
            seen[cut][near] = channels(found.evidence.streak.over(seen[cut]))[near]
    light = Gain.between(reduced(canvas.picture, grid, frame.shape), frame)
    lit = np.minimum(light.applied(seen), np.float32(255))
    # a small window fits the rim of a shadow, a large one tells better: what both reject is wrong
    scores = [unlikeness(channels(frame), lit, _ANY_LIGHT, noise=change.noise, window=window) for window in (3, 5)]
    unlike = np.minimum(*scores)
    # beside an object that is followed the rest of a change is its streak or its rim: there the comparison alone decides
    near = cv2.dilate((claims != _NOBODY).astype(np.uint8), _GROWN, iterations=_AROUND_STEPS) > 0
    strange = (change.changed & (claims == _NOBODY) & ~near).astype(np.uint8)
    # an upsampler looks a few video pixels around an edge: all of those are to come from one picture
    unknown = cv2.dilate(strange, _GROWN, iterations=_AROUND_STEPS)
    wrong = (unlike > UNEXPLAINED) | (unknown > 0)
    settled = cv2.morphologyEx(wrong.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    return np.asarray(cv2.dilate(settled, _GROWN) > 0)


def _cuts(objects: list[MovingObject], claims: NDArray[np.int16]) -> Mask:
    """Return where something stands before an object: the still does not know that border, so the video is to show it."""
    cuts = np.zeros(claims.shape, bool)
    for number, found in enumerate(objects):
        if found.evidence is not None:
            cut = found.evidence.box.cut
            mine = claims[cut] == number
            barred = cv2.dilate((found.evidence.visible & ~mine).astype(np.uint8), _GROWN, iterations=2)
            cuts[cut] |= (barred > 0) & (cv2.dilate(mine.astype(np.uint8), _GROWN, iterations=2) > 0)
    return cuts


def _with_video(
    frame: Picture, canvas: _Canvas, wrong: Mask, objects: tuple[MovingObject, ...], moving: Mask, S: Matrix
) -> GuideForFrame:
    """Put the enlarged frame, in the still's light, where the guide is wrong or unknown."""
    size = canvas.moved.shape[::-1]
    # unknown to the still, and wrong to the frame: both as shares of each still pixel
    share = cv2.warpAffine(wrong.astype(np.uint8) * np.uint8(255), S[:2], size, flags=cv2.INTER_LINEAR)
    share = np.maximum(share, canvas.unknown)
    flags = np.where(canvas.moved >= _HALF, np.uint8(Flag.MOVED), np.uint8(0))
    low = cv2.resize(share, frame.shape[1::-1], interpolation=cv2.INTER_AREA) >= _HALF
    if not share.any():
        return GuideForFrame(canvas.picture, flags, objects, moving, wrong)
    known = share < _HALF
    flags[~known] = np.uint8(Flag.GUIDE_IS_VIDEO)
    lit = frame
    if known.mean() > 0.1:
        seen = cv2.warpAffine(canvas.picture, S[:2], frame.shape[1::-1], flags=cv2.INTER_AREA | cv2.WARP_INVERSE_MAP)
        lit = Gain.between(frame, np.asarray(seen, np.uint8)).applied_to_bytes(frame)
    rows, columns = (np.flatnonzero(share.any(axis=axis)) for axis in (1, 0))
    top, left, bottom, right = int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1
    box = np.s_[top:bottom, left:right]
    M = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]]) @ S
    large = cv2.warpAffine(
        lit, M[:2], (right - left, bottom - top), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    weight = share[box].astype(np.float32) * np.float32(1 / 255)
    picture = canvas.picture
    picture[box] = _mixed(picture[box], np.asarray(large, np.uint8), weight)
    return GuideForFrame(picture, flags, objects, moving, wrong | low)
