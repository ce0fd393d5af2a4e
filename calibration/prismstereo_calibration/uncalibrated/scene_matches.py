"""The same points of a scene in both views of raw frames, wherever they lie: all that a rectification without a board has.

The frames of one unit share its geometry, so their matches are pooled. What disagrees with the geometry of the others is
dropped, and so is what is found at the same place in a second frame: a scene that stands still tells nothing twice.

Large pictures are searched in a smaller form, and each match is then set right in the picture itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.detection import NamedFrame, Rejection
from prismstereo_calibration.rectification import Rectification
from prismstereo_calibration.uncalibrated.partners import partners
from prismstereo_calibration.uncalibrated.registration import registered
from prismstereo_hw.errors import ImageError
from prismstereo_hw.view import View

__all__ = ["LEAST_MATCHES", "SceneMatches", "scene_matches"]

Array = NDArray[np.float64]

_FEATURES = 4000  # of each picture
_CONTRAST = 0.01  # a view through glass or off a mirror is pale; what is wrongly matched is found out by the geometry
_LARGEST_SEARCHED_PX = 1600  # longer side of a picture that is searched as it is
_OUTLIER_PX = 1.0  # in the picture that is searched
_SAME_PX = 2.0  # matches of two frames that lie so near each other are one
_MOST_TURN = 0.12  # of the focal length: a unit that differs more from its rig file was not built after it
_MOST_ROWS = 0.3  # of the frame's height: how far matches lie apart where nothing is known
LEAST_MATCHES = 32  # matches: half of them to fit eight numbers, half to judge
_MOST = 4000


@dataclass(frozen=True, slots=True)
class SceneMatches:
    """Matches of all frames together: left and right (N, 2) in upright pixels of their views, and the frames' size.

    The height is that of one exposure. `rejected`: the frames that gave none, and why.
    """

    left: Array
    right: Array
    views: tuple[View, View]
    frame_width: int
    frame_height: int
    frames: int
    rejected: tuple[Rejection, ...] = ()


def scene_matches(
    frames: Sequence[NamedFrame],
    views: tuple[View, View],
    expected: Rectification | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> SceneMatches:
    """Match both views of one or more frames of a unit; `progress(done, total, name)` is called after each frame.

    `expected` is the rectification that the unit's rig file promises: matches far from it are taken for mistakes.
    `ImageError` for no frame, frames of several sizes, and scenes that show too little that both views share.
    """
    if not frames:
        raise ImageError("0 frames: nothing can be matched without a picture, give one or more")
    size: tuple[int, int] | None = None
    found: list[tuple[Array, Array]] = []
    rejected: list[Rejection] = []
    step = 1
    for index, frame in enumerate(frames):
        size, step = _size(frame, views, size), _reduction(frame, views)
        try:
            found.append(_plausible(*_matches(frame, views, step), size, expected))
        except ImageError as error:
            rejected.append(Rejection(frame.name, str(error)))
        if progress is not None:
            progress(index + 1, len(frames), frame.name)
    if size is None or not found:
        raise ImageError(f"none of {len(frames)} frames can be used; {rejected[0].name}: {rejected[0].reason}")
    left, right = _once(*(np.concatenate([points[side] for points in found]) for side in (0, 1)))
    left, right = _consistent(left, right, _OUTLIER_PX * step)
    return SceneMatches(left, right, views, *size, len(found), tuple(rejected))


def _size(frame: NamedFrame, views: tuple[View, View], before: tuple[int, int] | None) -> tuple[int, int]:
    """Return width and height of one exposure; refuse a frame of another size than the first."""
    height, width = frame.pixels.shape[:2]
    size = width, height // views[0].exposures
    if before is not None and size != before:
        raise ImageError(
            f"{frame.name} is {size[0]}x{size[1]}, but the first frame {before[0]}x{before[1]}: give frames of one camera "
            "and mode"
        )
    return size


def _reduction(frame: NamedFrame, views: tuple[View, View]) -> int:
    """Return by which whole number the pictures are made smaller for the search."""
    longest = max(side for view in views for side in view.cut(frame.pixels).shape[:2])
    return -(-int(longest) // _LARGEST_SEARCHED_PX)


def _matches(frame: NamedFrame, views: tuple[View, View], step: int) -> tuple[Array, Array]:
    """Return matches (N, 2) of one frame in upright pixels of both views, those outside of their polygons left out."""
    pictures = [_grey(view.cut(frame.pixels)) for view in views]
    small = [_reduced(picture, step) for picture in pictures]
    left, right = partners(small[0], small[1], features=_FEATURES, contrast=_CONTRAST)
    if step > 1:
        left, right = (step * (points + 0.5) - 0.5 for points in (left, right))
        left, right = registered(pictures[0], pictures[1], left, right, reach_px=2.0 * step)
    height, width = frame.pixels.shape[0] // views[0].exposures, frame.pixels.shape[1]
    kept = np.ones(len(left), bool)
    upright = []
    for view, points in zip(views, (left, right), strict=True):
        x, y, _, _ = view.rectangle(width, height)
        upright.append(points + np.array([x, y], float))
        kept &= view.shows(view.raw_from_upright(upright[-1], width, height), width, height)
    return upright[0][kept], upright[1][kept]


def _plausible(left: Array, right: Array, size: tuple[int, int], expected: Rectification | None) -> tuple[Array, Array]:
    """Drop what a pattern that repeats looks like in its next repeat: far off its row, or at no depth of the rig's range."""
    if expected is not None and size == (expected.frame_width, expected.frame_height):
        apart = expected.rectify(left, expected.left) - expected.rectify(right, expected.right)
        slack = _MOST_TURN * expected.focal_px
        kept = (np.abs(apart[:, 1]) < slack) & (apart[:, 0] > -slack) & (apart[:, 0] < expected.window.labels + slack)
    else:
        kept = np.abs(left[:, 1] - right[:, 1]) < _MOST_ROWS * size[1]
    return left[kept], right[kept]


def _grey(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    pixels = np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8) if pixels.ndim == 3 else pixels


def _reduced(picture: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Average blocks of step x step pixels; rows and columns that fill no block are left out."""
    height, width = picture.shape[0] // step * step, picture.shape[1] // step * step
    size = width // step, height // step
    return np.asarray(cv2.resize(picture[:height, :width], size, interpolation=cv2.INTER_AREA), np.uint8)


def _once(left: Array, right: Array) -> tuple[Array, Array]:
    """Leave one of the matches that begin and end at the same places."""
    places = np.rint(np.concatenate([left, right], axis=1) / _SAME_PX)
    first = np.sort(np.unique(places, axis=0, return_index=True)[1])
    return left[first], right[first]


def _consistent(left: Array, right: Array, outlier_px: float) -> tuple[Array, Array]:
    """Keep the matches that obey one epipolar geometry, and of very many an even choice."""
    count = len(left)
    if count >= LEAST_MATCHES:
        _, inlier = cv2.findFundamentalMat(left, right, cv2.USAC_MAGSAC, outlier_px, 0.9999, 10_000)
        kept = np.flatnonzero(np.ravel(inlier)) if inlier is not None else np.zeros(0, int)
        if len(kept) > _MOST:
            kept = kept[np.linspace(0, len(kept) - 1, _MOST).astype(int)]
        left, right = left[kept], right[kept]
    if len(left) < LEAST_MATCHES:
        raise ImageError(
            f"{len(left)} of {count} points that look alike obey one geometry, and {LEAST_MATCHES} are needed: give more "
            "frames, of textured things at several distances, and check where the views lie"
        )
    return left, right
