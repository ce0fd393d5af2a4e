"""The foot of a sheet: a bar to measure, and in words what the sheet is and how to print it. Lengths in millimetres.

The bar is a ruler, measured from the middle of its first line to the middle of its last: ink that spreads moves the edges of
a line, but not its middle.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import numpy as np

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.target.ink import Ink

__all__ = ["Footer", "Line"]

_BAR_MM, _TICK_MM, _LINE_MM = 100.0, 10.0, 0.25
_TALL, _SHORT = 1.6, 0.9  # heights of the end lines and of those between, over the size of the letters
_LETTER_MM, _LETTER_SHARE = 2.8, 0.018  # at most; of the width of a small sheet
_ADVANCE = 0.52  # a letter's mean width over its size: Helvetica's is 0.5
_LEADING = 1.3
_ABOVE = 1.8  # paper above the bar, over the size of the letters
_PLACEHOLDER_MM = 1234.56


@dataclass(frozen=True, slots=True)
class Line:
    """Words that begin at x on a baseline y, in letters of a size; all in mm of the sheet frame."""

    text: str
    x_mm: float
    y_mm: float
    size_mm: float


@dataclass(frozen=True, slots=True)
class Footer:
    """The words, already cut into lines, and the length of the bar."""

    words: tuple[str, ...]
    bar_mm: float
    size_mm: float

    @classmethod
    def of(cls, board: Board, width_mm: float, *, coded: bool) -> Footer:
        """Make the footer of a board for a width; for one of unknown squares with room for any number."""
        size_mm = min(_LETTER_MM, _LETTER_SHARE * width_mm)
        bar_mm = min(_BAR_MM, max(width_mm // _TICK_MM, 1) * _TICK_MM)
        columns = max(int(width_mm / (_ADVANCE * size_mm)), 20)
        words = [
            line
            for text in _words(board, bar_mm, coded=coded)
            for line in textwrap.wrap(text, columns, break_on_hyphens=False)
        ]
        return cls(tuple(words), bar_mm, size_mm)

    @property
    def height_mm(self) -> float:
        """From the ink above to the last line's foot."""
        return (_ABOVE + _TALL + len(self.words) * _LEADING + 0.3) * self.size_mm

    def bar(self, left_mm: float, top_mm: float) -> Ink:
        """Return the bar of a footer whose upper left corner stands there."""
        places = left_mm + _LINE_MM / 2 + np.arange(0, self.bar_mm + _TICK_MM / 2, _TICK_MM)
        foot_mm = top_mm + (_ABOVE + _TALL) * self.size_mm
        tall = np.full(len(places), _SHORT)
        tall[[0, -1]] = _TALL
        ticks = np.stack(
            [
                places - _LINE_MM / 2,
                foot_mm - tall * self.size_mm,
                places + _LINE_MM / 2,
                np.full(len(places), foot_mm),
            ],
            axis=-1,
        )
        base = [places[0] - _LINE_MM / 2, foot_mm - _LINE_MM, places[-1] + _LINE_MM / 2, foot_mm]
        return Ink.of(np.concatenate([ticks, [base]]))

    def lines(self, left_mm: float, top_mm: float) -> tuple[Line, ...]:
        """Return the lines of a footer whose upper left corner stands there."""
        first_mm = top_mm + (_ABOVE + _TALL + 1.1) * self.size_mm
        return tuple(
            Line(text, left_mm, first_mm + index * _LEADING * self.size_mm, self.size_mm)
            for index, text in enumerate(self.words)
        )


def _words(board: Board, bar_mm: float, *, coded: bool) -> list[str]:
    """Say what the sheet is, how to print it and how to use it; ASCII, because plate makers' programs know no more."""
    square = _PLACEHOLDER_MM if board.square_mm is None else board.square_mm
    share = float(board.share or 0)
    what = (
        f"prismstereo target {board.name}, "
        + {
            "chessboard": f"squares of {square:g} mm ({board.columns} x {board.rows} inner corners)",
            "charuco": f"squares of {square:g} mm, markers of {share * square:g} mm from {board.dictionary}",
            "aprilgrid": f"tags of {square:g} mm from {board.dictionary}, gaps of {share * square:g} mm ({share:g} of a tag)",
        }[board.kind]
    )
    times = "" if bar_mm == _BAR_MM else f" (what you measure, times {_BAR_MM / bar_mm:g})"
    return [
        what + ".",
        f"Print at 100 %, not fitted to the page. The ruler above is {bar_mm:g} mm long from the middle of its first line "
        f"to the middle of its last; where it is not, say so: --bar-mm {0.996 * _BAR_MM:g}{times}. Glue it flat.",
        f"prismstereo calibrate FRAMES --board {board.name} --square-mm {square:g}"
        + (", or leave both out: the markers beside the board say them." if coded else "."),
    ]
