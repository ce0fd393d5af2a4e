"""What the printer did to the size: the check bar, measured, gives every square its true side."""

from __future__ import annotations

import math
from dataclasses import replace

from prismstereo_calibration.boards.board import Board
from prismstereo_hw.errors import UsageError

__all__ = ["printed"]

_MOST_OFF = 0.1  # a printer is off by a percent or two; more is another unit, or a page fitted to the paper


def printed(board: Board, bar_mm: float, bar_nominal_mm: float = 100.0) -> Board:
    """Return the board with squares as large as they were printed, where the bar of `bar_nominal_mm` measures `bar_mm`.

    `UsageError` for a bar that is more than a tenth off, and for a board of unknown squares.

    >>> printed(Board(9, 6, 25.0), bar_mm=99.6).square_mm
    24.9
    """
    if board.square_mm is None:
        raise UsageError(
            "a measured bar corrects the side of a square, but nobody said what it should be: add --square-mm"
        )
    ratio = bar_mm / bar_nominal_mm
    if not (math.isfinite(ratio) and abs(ratio - 1) <= _MOST_OFF):
        low, high = (1 - _MOST_OFF) * bar_nominal_mm, (1 + _MOST_OFF) * bar_nominal_mm
        raise UsageError(
            f"a bar of {bar_mm:g} mm instead of {bar_nominal_mm:g} mm: a printer's scale is within {low:g} to {high:g} mm, "
            "measure in millimetres from the first line to the last, or print again at 100 %"
        )
    return replace(board, square_mm=board.square_mm * ratio)
