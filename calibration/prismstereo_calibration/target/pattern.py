"""The ink of a board: every square, marker and tag of it, in the board frame of `prismstereo_calibration.boards.board`.

The one geometry behind every sheet, picture and test. A chessboard has a black upper left square. A ChArUco board is
OpenCV's (`cv2.aruco.CharucoBoard`, not the legacy pattern): black upper left square, markers row by row in the white
squares. An AprilGrid is Kalibr's: tags with a border of two modules, numbered row by row from the LOWER left, small black
squares between their corners. An inverted board is its negative, with a dark margin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.target.ink import Frame, Ink, Raster
from prismstereo_calibration.target.marker_bits import april_turned, dictionary, marker_bits
from prismstereo_hw.errors import UsageError

__all__ = ["MARGIN", "board_frame", "board_ink", "module_share", "raster", "tag_number"]

Array = NDArray[np.float64]

MARGIN = 0.5  # squares around a board that must be free of anything else
_KALIBR_BORDER = 2


def board_ink(board: Board, margin: float = MARGIN) -> Ink:
    """Return the ink of a board in its unit and frame; `margin` (in squares) is black around an inverted one.

    `UsageError` where the dictionary has fewer markers than the board.
    """
    made = {"chessboard": _chessboard, "charuco": _charuco, "aprilgrid": _aprilgrid}[board.kind](board)
    ink = Ink.of(made)
    if board.inverted:
        x0, y0, x1, y1 = board_frame(board, margin)
        return ink.negative((x0 / board.square, y0 / board.square, x1 / board.square, y1 / board.square)).moved(
            0, 0, board.square
        )
    return ink.moved(0, 0, board.square)


def board_frame(board: Board, margin: float = 0.0) -> Frame:
    """Return the rectangle that a board fills, with a margin in squares: x0, y0, x1, y1 in its unit and frame."""
    columns, rows = board.columns, board.rows
    if board.kind == "aprilgrid":
        gap = float(board.share or 0)
        sides = -gap, -gap, columns * (1 + gap), rows * (1 + gap)
    else:
        squares = 1 if board.kind == "chessboard" else 0  # a chessboard counts inner corners
        sides = -1.0, -1.0, columns - 1.0 + squares, rows - 1.0 + squares
    x0, y0, x1, y1 = sides
    square = float(board.square)
    return (x0 - margin) * square, (y0 - margin) * square, (x1 + margin) * square, (y1 + margin) * square


def raster(board: Board, pixels_per_mm: float, margin: float = 1.0) -> Raster:
    """Draw a board with a margin (in squares) around it; the raster's plane is the board's, z left out.

    For a board of unknown squares the scale is in pixels per square.
    """
    return board_ink(board, margin).raster(board_frame(board, margin), pixels_per_mm)


def module_share(board: Board) -> float:
    """Return the side of the smallest detail over the square: a module of a marker, an eighth where there is none."""
    if board.kind == "chessboard":
        return 1 / 8
    bits = int(dictionary(board.dictionary).markerSize)
    if board.kind == "aprilgrid":
        return 1 / (bits + 2 * _KALIBR_BORDER)
    return float(board.share or 0) / (bits + 2)


def tag_number(board: Board, column: int, row: int) -> int:
    """Return the number of an AprilGrid's tag; the row counts from the top, as in the board frame."""
    return board.columns * (board.rows - 1 - row) + column


def _chessboard(board: Board) -> Array:
    return _checks(board.columns + 1, board.rows + 1)


def _charuco(board: Board) -> Array:
    _require_markers(board)
    book, share = dictionary(board.dictionary), float(board.share or 0)
    white = [(x, y) for y in range(board.rows) for x in range(board.columns) if (x + y) % 2]
    edge = (1 - share) / 2 - 1
    markers = [
        _marker(marker_bits(book, number), 1) * share + np.tile([x + edge, y + edge], 2)
        for number, (x, y) in enumerate(white)
    ]
    return np.concatenate([_checks(board.columns, board.rows), *markers])


def _aprilgrid(board: Board) -> Array:
    _require_markers(board)
    book, gap = dictionary(board.dictionary), float(board.share or 0)
    turns = 2 if "h" in board.dictionary and april_turned() else 0
    tags = [
        _marker(np.rot90(marker_bits(book, tag_number(board, x, y)), turns), _KALIBR_BORDER)
        + np.tile([x * (1 + gap), y * (1 + gap)], 2)
        for y in range(board.rows)
        for x in range(board.columns)
    ]
    y, x = np.divmod(np.arange((board.columns + 1) * (board.rows + 1)), board.columns + 1)
    corners = np.stack([x * (1 + gap) - gap, y * (1 + gap) - gap, x * (1 + gap), y * (1 + gap)], axis=-1)
    return np.concatenate([corners, *tags])


def _checks(columns: int, rows: int) -> Array:
    """Return the black squares of so many, the first at (-1, -1) black."""
    y, x = np.divmod(np.arange(columns * rows), columns)
    black = (x + y) % 2 == 0
    x, y = x[black] - 1.0, y[black] - 1.0
    return np.stack([x, y, x + 1, y + 1], axis=-1)


def _marker(black: NDArray[np.bool_], border: int) -> Array:
    """Return the black modules of a marker of side 1 with its upper left corner at the origin."""
    modules = np.pad(black, border, constant_values=True)
    y, x = np.nonzero(modules)
    return np.stack([x, y, x + 1, y + 1], axis=-1) / len(modules)


def _require_markers(board: Board) -> None:
    there_are = len(dictionary(board.dictionary).bytesList)
    if board.marker_count > there_are:
        raise UsageError(
            f"board {board.name} needs {board.marker_count} markers, but {board.dictionary} has {there_are}: give fewer "
            "squares, or a larger dictionary"
        )
