"""Where a board can be held so that both views show all of it: the candidates for the next view.

Board frame as in `board`, camera frame that of the left camera. A tilt is about the board's own middle, a board without one
faces the middle between the two cameras.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.judging.view_field import at_depth, common, grid, shows
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.poses import rotations

__all__ = ["Place", "places"]

Array = NDArray[np.float64]
About = Literal["", "vertical", "horizontal"]

_TILT_DEG = 30.0
_TILTS: tuple[tuple[About, float], ...] = (
    ("", 0.0),
    ("vertical", _TILT_DEG),
    ("vertical", -_TILT_DEG),
    ("horizontal", _TILT_DEG),
    ("horizontal", -_TILT_DEG),
)
_DISTANCES = 12  # tried, of which the nearest, the middle and the farthest that the board fits are kept
_NEAREST, _FARTHEST = 0.5, 4.0  # of the near end of the range
_LEAST_SQUARE_PX = 12.0  # that a detector still finds when the board is tilted
_MARGIN_PX = 6.0
_GRID = 32


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A pose of a board: its corners (N, 3) in the left camera's frame, and how to say where that is.

    `middle_px`: where the left view shows the board's middle, upright. `about`: the line the board is tilted about, "" for a
    board that faces the cameras; a positive tilt brings the right side, or the upper one, towards the cameras.
    """

    points: Array
    middle_px: Array
    depth: float
    about: About
    tilt_deg: float


def places(calibration: Calibration, board: Board) -> tuple[Place, ...]:
    """Return places near, halfway and far, all over the common field, level and tilted; none where the board does not fit."""
    near, far = calibration.range.near_mm, calibration.range.far_mm
    sharp = calibration.left.lens.fx_px * board.square / _LEAST_SQUARE_PX
    last = min(_FARTHEST * near, far, sharp)
    if last <= _NEAREST * near:
        return ()
    found = [_at(calibration, board, float(depth)) for depth in np.geomspace(_NEAREST * near, last, _DISTANCES)]
    fitting = [some for some in found if some]
    chosen = sorted({0, len(fitting) // 2, len(fitting) - 1}) if fitting else []
    return tuple(place for index in chosen for place in fitting[index])


def _at(calibration: Calibration, board: Board, depth: float) -> list[Place]:
    """Return the places at one depth: at most nine, each with five tilts."""
    pixels = grid(calibration, "left", _GRID, _GRID)
    seen = pixels[common(calibration, "left", pixels, depth)]
    if not len(seen):
        return []
    flat = board.points() - (board.points().min(axis=0) + board.points().max(axis=0)) / 2
    lens = calibration.left.lens
    half = flat.max(axis=0)[:2] * np.array([lens.fx_px, lens.fy_px]) / depth + _MARGIN_PX
    low, high = seen.min(axis=0) + half, seen.max(axis=0) - half
    middle = (low + high) / 2
    low, high = np.minimum(low, middle), np.maximum(high, middle)
    found = []
    for x in _three(low[0], high[0]):
        for y in _three(low[1], high[1]):
            centre = at_depth(calibration.left, np.array([x, y]), depth)
            facing = _facing(calibration, centre)
            for about, tilt_deg in _TILTS:
                points = flat @ (facing @ _tilt(about, tilt_deg)).T + centre
                found.append(Place(points, np.array([x, y]), depth, about, tilt_deg))
    return [place for place, fits in zip(found, _fit(calibration, found), strict=True) if fits]


def _three(low: float, high: float) -> tuple[float, ...]:
    return (low, (low + high) / 2, high) if high - low > _MARGIN_PX else ((low + high) / 2,)


def _fit(calibration: Calibration, found: list[Place]) -> NDArray[np.bool_]:
    """Tell which of some places (P,) both views show whole."""
    points = np.stack([place.points for place in found])
    left, right = calibration.left.project(points), calibration.right.project(points)
    both = shows(calibration, "left", left, _MARGIN_PX) & shows(calibration, "right", right, _MARGIN_PX)
    return np.asarray(both.all(axis=1))


def _facing(calibration: Calibration, centre: Array) -> Array:
    """Return R_left_from_board of a board at `centre` that faces the middle between the cameras, its rows along them."""
    z = centre - calibration.right.centre / 2
    z = z / np.linalg.norm(z)
    x = calibration.right.centre - z * (calibration.right.centre @ z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _tilt(about: About, tilt_deg: float) -> Array:
    axis = np.array([float(about == "horizontal"), float(about == "vertical"), 0.0])
    return rotations(math.radians(tilt_deg) * axis)
