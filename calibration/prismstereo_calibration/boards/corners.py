"""The corners of a board in one picture, or the reason why there are none to measure by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.chessboard import find_chessboard
from prismstereo_calibration.boards.fitness import fitness
from prismstereo_calibration.boards.marker_corners import find_marker_corners
from prismstereo_calibration.boards.refusal import NO_BOARD, Refusal
from prismstereo_calibration.boards.saddle import grey_of

__all__ = ["Found", "Refusal", "find_corners", "look"]

Array = NDArray[np.float64]

_SMALLEST_PICTURE = 16


@dataclass(frozen=True, slots=True)
class Found:
    """A board's corners (N, 2) in a picture, NaN where one is unseen, and how wide its edges are there."""

    pixels: Array
    edge_px: float


def find_corners(image: NDArray[np.uint8], board: Board) -> Array | Refusal:
    """Find a board's corners in a picture, (height, width[, 3]) uint8.

    Returns (N, 2) float64 pixels of that picture in the order of `board.points()`; or the reason why there are none. A
    chessboard must be seen whole; its rows run to the right where there is a choice. Of a board with markers a part is enough,
    and corners that are not seen are NaN.
    """
    found = look(image, board)
    return found if isinstance(found, Refusal) else found.pixels


def look(image: NDArray[np.uint8], board: Board, stretch: tuple[float, float] = (1.0, 1.0)) -> Found | Refusal:
    """Find a board's corners as `find_corners` does; the picture's pixels are square once it is stretched in x and y."""
    grey = grey_of(image)
    if min(grey.shape) < _SMALLEST_PICTURE:
        return NO_BOARD
    if board.inverted:
        grey = 255 - grey
    corners = find_marker_corners(grey, board) if board.named_corners else find_chessboard(grey, board)
    if isinstance(corners, Refusal):
        return corners
    seen = fitness(grey, corners, board, stretch)
    fault = seen.fault(board)
    return Found(corners, seen.edge_px) if fault is None else Refusal(fault)
