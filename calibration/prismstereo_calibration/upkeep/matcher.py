"""Corners of the left view found again in the right one, to a tenth of a pixel both ways.

Both views are rectified with the calibration at hand, which is nearly right: a partner lies within a few rows. It is searched
by normalised correlation along these rows, refined by Lucas and Kanade's method in both directions, and kept only where the way
back leads home.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, RectifiedView, rectification
from prismstereo_calibration.upkeep.sightlines import SceneMatches
from prismstereo_hw.frame import RawFrame

__all__ = ["SceneMatcher"]

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

_CORNERS = 1200
_CORNER_QUALITY = 0.003
_APART_PX = 7.0
_TEMPLATE = 15  # pixels a side
_WINDOW = 21  # of the refinement
_ROWS_OFF = 8  # farther off its row, the unit needs a board
_ALIKE = 0.8  # least correlation
_DISTINCT = 0.05  # by which the best place beats every other
_BACK_PX = 0.3
_RIM = 2 * (_WINDOW // 2) + 1
_LEAST_CONTRAST = 3.0  # grey levels, one standard deviation within a template: below, it is noise that is matched
_NOWHERE = -16.0


class SceneMatcher:
    """Matches the two views of raw frames of one calibrated unit; the maps are made once."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._how = rectification(calibration)
        self._maps = [_Map(self._how, side) for side in (self._how.left, self._how.right)]

    def match(self, name: str, frame: RawFrame) -> SceneMatches:
        """Return what both views of a frame show; nothing for a scene without texture.

        `CalibrationError` for a frame of another size or focus than the calibration's.
        """
        self._calibration.require_frame(frame)
        left, right = (
            one.apply(view.cut(frame.pixels)) for one, view in zip(self._maps, self._calibration.views, strict=True)
        )
        corners = _corners(left, self._maps[0].inner)
        guesses, found = _along_rows(left, right, corners, self._how.window.labels)
        corners, partners = _refined(left, right, corners[found], guesses[found])
        kept = self._maps[0].shows(corners) & self._maps[1].shows(partners)
        return SceneMatches(name, self._maps[0].upright(corners[kept]), self._maps[1].upright(partners[kept]))


class _Map:
    """One view's way to its rectified picture and back."""

    def __init__(self, how: Rectification, side: RectifiedView) -> None:
        self._sources = how.sources(side)
        x, y, _, _ = side.view.rectangle(how.frame_width, how.frame_height)
        self._corner = np.array([x, y], float)
        seen = np.isfinite(self._sources[..., 0]).astype(np.uint8)
        self.inner = cv2.erode(seen, np.ones((_RIM, _RIM), np.uint8), borderValue=0).astype(np.uint8)

    def apply(self, picture: Picture) -> Picture:
        """Rectify a cut-out view, in grey."""
        grey = np.ascontiguousarray(picture)
        if grey.ndim == 3:
            grey = np.asarray(cv2.cvtColor(grey, cv2.COLOR_BGR2GRAY), np.uint8)
        filled = np.nan_to_num(self._sources, nan=_NOWHERE)
        return np.asarray(cv2.remap(grey, filled[..., 0].copy(), filled[..., 1].copy(), cv2.INTER_CUBIC), np.uint8)

    def shows(self, points: Array) -> NDArray[np.bool_]:
        """Tell which rectified points (N, 2) are well inside the view."""
        columns, rows = np.rint(points).astype(int).T
        height, width = self.inner.shape
        within = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
        return np.asarray(within & (self.inner[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)] > 0))

    def upright(self, points: Array) -> Array:
        """Take rectified points (N, 2) that the view shows to its upright pixels."""
        corner = np.floor(points).astype(int)
        height, width = self.inner.shape
        corner = np.clip(corner, 0, np.array([width, height]) - 2)
        part = points - corner
        found = np.zeros_like(points)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            found += weight[:, None] * self._sources[corner[:, 1] + dy, corner[:, 0] + dx].astype(np.float64)
        return np.asarray(found + self._corner)


def _corners(picture: Picture, inner: Picture) -> Array:
    """Return the places (N, 2) that differ from their surroundings every way, well inside the view."""
    found = cv2.goodFeaturesToTrack(picture, _CORNERS, _CORNER_QUALITY, _APART_PX, mask=inner, blockSize=5)
    places: list[object] = [] if found is None else [found]  # a picture without a corner gives None
    corners = np.array(places, np.float64).reshape(-1, 2)
    grey = picture.astype(np.float64)
    size = (_TEMPLATE, _TEMPLATE)
    mean = cv2.blur(grey, size)
    contrast = np.sqrt(np.maximum(cv2.blur(grey * grey, size) - mean * mean, 0.0))
    columns, rows = np.rint(corners).astype(int).T
    return np.asarray(corners[contrast[rows, columns] > _LEAST_CONTRAST])


def _along_rows(left: Picture, right: Picture, corners: Array, labels: int) -> tuple[Array, NDArray[np.bool_]]:
    """Return the likeliest partners (N, 2), to whole pixels, and which corners (N,) have one that is the only one."""
    half, (height, width) = _TEMPLATE // 2, left.shape
    guesses, found = corners.copy(), np.zeros(len(corners), bool)
    for index, (x, y) in enumerate(np.rint(corners).astype(int)):
        top, bottom = max(0, y - half - _ROWS_OFF), min(height, y + half + _ROWS_OFF + 1)
        begin, end = max(0, x - labels - half), min(width, x + half + 1)
        template = left[y - half : y + half + 1, x - half : x + half + 1]
        strip = right[top:bottom, begin:end]
        if template.shape != (_TEMPLATE, _TEMPLATE) or strip.shape[0] < _TEMPLATE or strip.shape[1] < _TEMPLATE:
            continue
        likeness = cv2.matchTemplate(strip, template, cv2.TM_CCOEFF_NORMED)
        best = int(np.argmax(likeness))
        row, column = divmod(best, likeness.shape[1])
        peak = float(likeness[row, column])
        likeness[max(0, row - 3) : row + 4, max(0, column - 3) : column + 4] = -1
        found[index] = peak > _ALIKE and float(likeness.max()) < peak - _DISTINCT
        guesses[index] += [begin + column + half - x, top + row + half - y]
    return guesses, found


def _refined(left: Picture, right: Picture, corners: Array, guesses: Array) -> tuple[Array, Array]:
    """Return corners and partners (N, 2) to a fraction of a pixel: those from where the way back leads home."""
    if not len(corners):
        return corners, guesses
    start = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    there, seen = _tracked(left, right, start, np.ascontiguousarray(guesses, np.float32).reshape(-1, 1, 2))
    back, again = _tracked(right, left, there, start)
    off = np.linalg.norm(np.reshape(back - start, (-1, 2)), axis=1)
    kept = seen & again & (off < _BACK_PX)
    return corners[kept], np.reshape(there, (-1, 2)).astype(np.float64)[kept]


def _tracked(
    one: Picture, other: Picture, points: NDArray[np.float32], guesses: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 0.003)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        one,
        other,
        points,
        guesses.copy(),
        winSize=(_WINDOW, _WINDOW),
        maxLevel=0,
        criteria=criteria,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(found, np.float32), np.ravel(status).astype(bool)
