"""The inner corners of a chessboard in one picture, to a fraction of a pixel, in a settled order.

Two detectors are asked in turn: the quadrangle linker is ten times faster and misses less on small pictures, the sector
detector stands more blur and shade. Their answers are refined on the corner's saddle in the same way. Either may be content
with a part of a larger board, which would give every view another origin, or lay a grid askew; such finds are refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.lattice import largest_lattice
from prismstereo_calibration.boards.refusal import NO_BOARD, Refusal
from prismstereo_calibration.boards.saddle import centred, grey_of, refined, sample

__all__ = ["agree", "find_chessboard", "found_sizes"]

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

_LINKER = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK
_SECTORS = (
    cv2.CALIB_CB_NORMALIZE_IMAGE,
    cv2.CALIB_CB_EXHAUSTIVE,
)  # evened out grey for dim boards; as it is for dark rooms
_ANY_SIZE = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
_LATTICE_SHARE = 0.7  # of the corners: with fewer in a net there is no whole board, and no need for the slow detectors
_LEAST_ANY_SIZE = (4, 4)
_LARGE_PX, _SMALL_PX = 1200, 900  # longest side of a picture that is also looked at made small
_ROUND = np.stack(np.meshgrid(*[np.linspace(-0.35, 0.35, 12)] * 2), axis=-1).reshape(
    -1, 2
)  # places round a corner, in squares
_HALF_ROUND = _ROUND[: len(_ROUND) // 2]
_REFINE_SHARE = 0.3  # half side of the refining window, in spacings of the nearest two corners
_SMALLEST_PICTURE = 16
_CROSSING_SHARE = 0.7  # of a row beyond the found ones: that many X-corners, and the board goes on
_CROSSING_CONTRAST = 0.35  # of the board's own contrast
_CHECKER_SHARE = 0.7  # of the board's contrast at its corners
_STRAY = 0.3  # spacings between a corner and where its neighbours put it: then the neighbours are right
_NEIGHBOURS = 3
_MOST_BEND = 0.5  # spacings; barrel distortion of k1 -0.3 makes 0.3
_ARM = 0.3  # squares from the corner at which the four squares are looked at: boards with narrow outer squares exist


def find_chessboard(grey: Grey, board: Board) -> Array | Refusal:
    """Find all inner corners of a chessboard in a grey picture (height, width) uint8.

    Returns (N, 2) float64 pixels of that picture, row after row of the board, x growing to the right where there is a
    choice and always right-handed; or the reason why there are none.
    """
    refusal = NO_BOARD
    if largest_lattice(grey) < _LATTICE_SHARE * board.corner_count:
        return refusal
    for corners in _finds(grey, (board.columns, board.rows)):
        grid = _without_strays(corners.reshape(board.rows, board.columns, 2))
        doubt = _doubt(grey, grid)
        if doubt is None:
            settled = refined(grey, grid.reshape(-1, 2), _REFINE_SHARE * _spacing(grid).ravel()).reshape(grid.shape)
            return np.ascontiguousarray(_settled(_centred(grey, settled))).reshape(-1, 2)
        refusal = Refusal(doubt) if refusal is NO_BOARD else refusal
    return refusal


def _finds(grey: Grey, size: tuple[int, int]) -> Iterator[Array]:
    """Yield what each detector in turn takes for a board of that size, (N, 2) pixels."""
    found, corners = cv2.findChessboardCorners(grey, size, flags=_LINKER)
    if found and np.size(corners) == 2 * size[0] * size[1]:
        yield np.reshape(corners, (-1, 2)).astype(np.float64)
    for picture in _sizes(grey):
        scale = np.array(grey.shape[::-1]) / np.array(picture.shape[::-1])
        for flags in _SECTORS:
            found, corners = cv2.findChessboardCornersSB(picture, size, flags=flags)
            if found and np.size(corners) == 2 * size[0] * size[1]:
                yield (np.reshape(corners, (-1, 2)).astype(np.float64) + 0.5) * scale - 0.5


def _sizes(grey: Grey) -> Iterator[Grey]:
    """Yield a large picture made small, then the picture itself: sectors of very many pixels are missed, and take long."""
    longest = max(grey.shape)
    if longest > _LARGE_PX:
        shrink = _SMALL_PX / longest
        yield np.asarray(cv2.resize(grey, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.uint8)
    yield grey


def _centred(grey: Grey, grid: Array) -> Array:
    """Move corners to where their surroundings look the same upside down: a fifth of the error that the saddle leaves."""
    across, along = (np.gradient(grid, axis=axis).reshape(-1, 1, 2) for axis in (1, 0))
    offsets = _HALF_ROUND[:, :1] * across + _HALF_ROUND[:, 1:] * along
    return centred(grey, grid.reshape(-1, 2), offsets, -offsets).reshape(grid.shape)


def _without_strays(grid: Array) -> Array:
    """Put corners that the detector mistook where both their row and their column want them."""
    rows, columns = grid.shape[:2]
    by_row = np.einsum("ij,rjk->rik", _from_neighbours(columns), grid)
    by_column = np.einsum("ij,jck->ick", _from_neighbours(rows), grid)
    wanted, limit = (by_row + by_column) / 2, _STRAY * _spacing(grid)
    agreed = np.linalg.norm(by_row - by_column, axis=-1) < limit
    stray = agreed & (np.linalg.norm(grid - wanted, axis=-1) > limit)
    return np.where(stray[..., None], wanted, grid)


def _from_neighbours(count: int) -> Array:
    """Return weights (count, count): each place of a line from its three nearest others, along a parabola."""
    weights = np.zeros((count, count))
    for place in range(count):
        others = sorted((other for other in range(count) if other != place), key=lambda other: abs(other - place))
        others = others[:_NEIGHBOURS]
        for j in others:
            weights[place, j] = math.prod((place - k) / (j - k) for k in others if k != j)
    return weights


def _settled(grid: Array) -> Array:
    """Turn the grid right-handed, and its rows to the right as far as the board's own symmetry lets it."""
    x, y = (grid[:, -1] - grid[:, 0]).mean(axis=0), (grid[-1] - grid[0]).mean(axis=0)
    if x[0] * y[1] - x[1] * y[0] < 0:
        grid = grid[:, ::-1]
    return max(_turns(grid), key=lambda g: float((g[:, -1] - g[:, 0]).mean(axis=0) @ np.array([1.0, 0.5])))


def _turns(grid: Array) -> list[Array]:
    """List the grid as the board would show it after each turn that keeps its number of rows."""
    quarter = grid.shape[0] == grid.shape[1]
    return [np.rot90(grid, turn) for turn in range(0, 4, 1 if quarter else 2)]


def agree(reference: Array, corners: Array, board: Board) -> Array:
    """Return `corners` (N, 2) in that order, of those the board's symmetry allows, which matches `reference` best.

    Both are upright pixels of the two views of one exposure, so the board is turned alike in them.
    """
    shape = (board.rows, board.columns, 2)
    wanted = (reference - reference.mean(axis=0)).reshape(shape)
    middle = corners.mean(axis=0)
    best = min(_turns(corners.reshape(shape)), key=lambda g: float(np.linalg.norm(g - middle - wanted, axis=-1).sum()))
    return np.ascontiguousarray(best).reshape(-1, 2)


def _doubt(grey: Grey, grid: Array) -> str | None:
    """Say why a grid (rows, columns, 2) is not the whole of a chessboard: crooked, not checkered, or it goes on."""
    if _bend(grid) > _MOST_BEND:
        return "no board"
    crossing = _crossings(grey, _with_border(grid))
    contrast = float(np.median(crossing[1:-1, 1:-1]))
    clear = crossing > _CROSSING_CONTRAST * contrast
    by_row, by_column = clear[:, 1:-1].mean(axis=1), clear[1:-1].mean(axis=0)
    if min(by_row[1:-1].min(), by_column[1:-1].min()) < _CROSSING_SHARE or not contrast > 0:
        return "no board"
    if _checker_contrast(grey, grid) < _CHECKER_SHARE * contrast:
        return "no board"
    if max(by_row[0], by_row[-1], by_column[0], by_column[-1]) > _CROSSING_SHARE:
        return f"the board is larger than {grid.shape[1]}x{grid.shape[0]}"
    return None


def _checker_contrast(grey: Grey, grid: Array) -> float:
    """Return how much brighter one half of the squares is in their middles; about 0 for a grid laid askew."""
    middle = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    value = sample(grey, middle)
    even = np.indices(value.shape).sum(axis=0) % 2 == 0
    return abs(float(np.mean(value[even]) - np.mean(value[~even])))


def _bend(grid: Array) -> float:
    """Return how far the grid is from a plane one in perspective, the worst corner, in spacings of the nearest two."""
    rows, columns = grid.shape[:2]
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float64)
    flat = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    H, _ = cv2.findHomography(flat, grid.reshape(-1, 1, 2))
    if np.shape(H) != (3, 3):  # empty where the corners are all on one line
        return np.inf
    off = cv2.perspectiveTransform(flat, H).reshape(grid.shape) - grid
    return float(np.linalg.norm(off, axis=-1).max() / _spacing(grid).min())


def _spacing(grid: Array) -> Array:
    """Return the distance of each place of a grid to its nearest neighbour, (rows, columns) pixels."""
    nearest = np.full(grid.shape[:2], np.inf)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(grid, axis=axis), axis=-1)
        before, after = (np.insert(step, place, np.inf, axis=axis) for place in (0, step.shape[axis]))
        nearest = np.minimum(nearest, np.minimum(before, after))
    return nearest


def _with_border(grid: Array) -> Array:
    """Continue a grid by one place on each side, along parabolas: good enough for perspective and distortion."""
    for axis in (0, 1):
        g = np.moveaxis(grid, axis, 0)
        g = np.concatenate([3 * g[:1] - 3 * g[1:2] + g[2:3], g, 3 * g[-1:] - 3 * g[-2:-1] + g[-3:-2]])
        grid = np.moveaxis(g, 0, axis)
    return grid


def _crossings(grey: Grey, grid: Array) -> Array:
    """Return how clearly four squares meet, by turns dark and bright, at every place of a grid, in grey values.

    Of like squares the less clear one counts, and from place to place dark and bright must change over: a grid laid
    askew over a board has negative values or about 0. -1 outside the picture.
    """
    across, along = (_ARM * np.gradient(grid, axis=axis) for axis in (1, 0))
    a, b = sample(grey, grid + across + along), sample(grey, grid - across - along)
    c, d = sample(grey, grid + across - along), sample(grey, grid - across + along)
    bright, dark = np.minimum(a, b) - np.maximum(c, d), np.minimum(c, d) - np.maximum(a, b)
    even = np.indices(bright.shape).sum(axis=0) % 2 == 0
    one, other = np.where(even, bright, dark), np.where(even, dark, bright)
    crossing = one if np.nanmedian(one[1:-1, 1:-1]) > np.nanmedian(other[1:-1, 1:-1]) else other
    return np.where(np.isnan(crossing), -1.0, crossing)


def found_sizes(image: NDArray[np.uint8]) -> tuple[int, int] | None:
    """Return columns and rows (the larger first) of whatever chessboard is in a picture; None where there is none."""
    grey = grey_of(image)
    if min(grey.shape) < _SMALLEST_PICTURE or largest_lattice(grey) < _LATTICE_SHARE * math.prod(_LEAST_ANY_SIZE):
        return None
    for evened in (cv2.CALIB_CB_NORMALIZE_IMAGE, 0):
        found, _, meta = cv2.findChessboardCornersSBWithMeta(grey, _LEAST_ANY_SIZE, _ANY_SIZE | evened)
        if found and np.ndim(meta) >= 2:
            rows, columns = np.shape(meta)[:2]
            return max(rows, columns), min(rows, columns)
    return None
