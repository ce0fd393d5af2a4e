"""The board: where its corners are, and which boards are none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from prismstereo_calibration.boards.board import Board
from prismstereo_hw.errors import UsageError


def test_corners_stand_row_after_row_one_square_apart() -> None:
    points = Board(4, 3, 25.0).points()
    assert points.shape == (12, 3)
    assert Board(4, 3, 25).points().dtype == np.float64
    np.testing.assert_array_equal(points[:5], [[0, 0, 0], [25, 0, 0], [50, 0, 0], [75, 0, 0], [0, 25, 0]])


def test_a_board_of_unknown_squares_measures_in_squares() -> None:
    board = Board.parse("chessboard:9x6")
    assert board.unit == "square"
    np.testing.assert_array_equal(board.points()[-1], [8, 5, 0])


def test_a_board_reads_its_own_name() -> None:
    board = Board(11, 8, 12.5)
    assert Board.parse(board.name, 12.5) == board


@pytest.mark.parametrize(
    ("text", "square_mm", "complaint"),
    [
        ("9x6", None, "write chessboard:9x6"),
        ("chessboard:9", None, "write chessboard:9x6"),
        ("chessboard:9x6x3", None, "write chessboard:9x6"),
        ("chessboard:2x6", None, "3 to 64 inner corners"),
        ("chessboard:9x65", None, "3 to 64 inner corners"),
        ("circles:9x6", None, "'circles' are not supported: write chessboard"),
        ("chessboard:9x6", 0.0, "square of 0 mm"),
        ("chessboard:9x6", -3.0, "square of -3 mm"),
        ("chessboard:9x6", math.nan, "square of nan mm"),
        ("chessboard:9x6", math.inf, "square of inf mm"),
        ("chessboard:9x6", 1e5, "square of 100000 mm"),
    ],
)
def test_a_board_that_cannot_be_is_refused(text: str, square_mm: float | None, complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        Board.parse(text, square_mm)
