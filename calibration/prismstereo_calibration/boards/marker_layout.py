"""Where the markers of a board stand, and what its corners look like: the geometry that detection goes by.

Lengths are squares (tags of an AprilGrid) in the board frame of `boards.board`. Corners of a marker go round clockwise from the
one that is upper left when its code is read upright.

One name may stand for several prints. ChArUco boards of OpenCV before 4.6 begin with a white square where the number of rows
is even. Kalibr turns its tags upside down and gives them two modules of black border; others print them with one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board

__all__ = ["MarkerLayout", "border_modules", "marker_layouts"]

Array = NDArray[np.float64]

_UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_KALIBR_FIRST = (2, 0, 1, 3)  # quarter turns of a tag


@dataclass(frozen=True, slots=True)
class MarkerLayout:
    """One print of a marker board.

    `markers` (M, 4, 2): the corners of marker 0, 1, ... `saddles` (N, 2): the board's corners. `rising` (N,): whether the dark
    squares at a corner are the upper right and the lower left one. `gutter`: how far from the sides of a bright square
    something dark may begin. `reach`: how far around a corner the print is sure, and the same turned by 180 degrees.
    """

    markers: Array
    saddles: Array
    rising: NDArray[np.bool_]
    gutter: float
    reach: float

    def shade(self, offsets: Array) -> Array:
        """Return how bright the print is, -1 or 1, at offsets (K, 2) from each corner that are within reach: (N, K)."""
        across = offsets[:, 0] * offsets[:, 1] > 0
        bright = across[None, :] == self.rising[:, None]
        inside = np.abs(offsets).min(axis=1) > self.gutter
        return np.where(bright & ~inside, 1.0, -1.0)


def border_modules(board: Board) -> tuple[int, ...]:
    """Tell how many modules of black border a board's markers may have, the likelier number first."""
    return (2, 1) if board.kind == "aprilgrid" else (1,)


def marker_layouts(board: Board, border: int) -> Iterator[MarkerLayout]:
    """Yield the prints that a marker board of that name may be, the likeliest first."""
    if board.kind == "aprilgrid":
        yield from (_aprilgrid(board, border, turns) for turns in _KALIBR_FIRST)
        return
    yield _charuco(board, white_first=False)
    if board.rows % 2 == 0:
        yield _charuco(board, white_first=True)


def _modules(board: Board, border: int) -> int:
    """Return how many modules a marker has from side to side: 4x4_50 has 4 and its border, 36h11 6 and its border."""
    bits = {"16": 4, "25": 5, "36": 6}
    first = board.dictionary.partition("h")[0] if "h" in board.dictionary else ""
    return (bits[first] if first else int(board.dictionary[0])) + 2 * border


def _charuco(board: Board, white_first: bool) -> MarkerLayout:
    share = float(board.share or 0)
    y, x = np.divmod(np.arange(board.columns * board.rows), board.columns)
    white = (x + y) % 2 == (0 if white_first else 1)
    squares = np.stack([x, y], axis=-1)[white] - 1.0  # the board's origin is its first INNER corner
    markers = squares[:, None, :] + (1 - share) / 2 + share * _UNIT
    saddles = board.points()[:, :2] / board.square
    rising = (saddles.sum(axis=1) % 2 == 0) == white_first
    gutter = (1 - share) / 2
    return MarkerLayout(markers, saddles, rising, gutter, min(0.35, gutter + share / _modules(board, 1)))


def _aprilgrid(board: Board, border: int, turns: int) -> MarkerLayout:
    pitch = 1 + float(board.share or 0)
    row, column = np.divmod(np.arange(board.columns * board.rows), board.columns)
    origins = np.stack([column, board.rows - 1 - row], axis=-1) * pitch  # tag 0 is the lower left one
    markers = origins[:, None, :] + np.roll(_UNIT, -turns, axis=0)
    saddles = board.points()[:, :2] / board.square
    rows, columns = np.divmod(np.arange(len(saddles)), 2 * board.columns)
    rising = (rows + columns) % 2 == 1
    return MarkerLayout(markers, saddles, rising, np.inf, min(0.35, border / _modules(board, border), pitch - 1))
