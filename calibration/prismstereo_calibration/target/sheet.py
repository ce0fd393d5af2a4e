"""A sheet: the board, its code, a bar to measure and a description, each at its place on the page.

Sheet frame: millimetres, origin in the upper left corner of the page, x right, y down. `pdf`, `svg` and `dxf` write what is
placed here and reckon nothing themselves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.target.code import PLACES, code_dictionary, encode, obstacle
from prismstereo_calibration.target.code_strip import CodeStrip
from prismstereo_calibration.target.footer import Footer, Line
from prismstereo_calibration.target.ink import Ink
from prismstereo_calibration.target.page import Page
from prismstereo_calibration.target.pattern import MARGIN, board_frame, board_ink, module_share
from prismstereo_hw.errors import UsageError

__all__ = ["Sheet", "lay_out"]

_STEP_MM = 0.5  # in which the largest square is chosen
_SMALLEST_MM, _LARGEST_MM = 1.0, 999.5  # squares that are chosen: what the code can say
_EXACT = 1e-9
_MARGIN_MM, _MARGIN_SHARE = 8.0, 0.05  # of the page that printers leave white; of a small page's shorter side


@dataclass(frozen=True, slots=True)
class Sheet:
    """All that is on a page; inks in the sheet frame, `board_at_mm` is where the board's corner 0 stands."""

    page: Page
    board: Board
    board_at_mm: tuple[float, float]
    pattern: Ink
    code: Ink | None
    bar: Ink
    bar_mm: float
    lines: tuple[Line, ...]
    code_markers: tuple[int, ...] = ()
    no_code: str = ""  # why there is none

    @property
    def ink(self) -> Ink:
        """All that is black but the words."""
        return (self.pattern if self.code is None else self.pattern.beside(self.code)).beside(self.bar)


@dataclass(frozen=True, slots=True)
class _Arrangement:
    """One way to place a board and its code on a page; sizes in squares, the code's rows below the board or right of it."""

    page: Page
    footer: Footer
    strip: CodeStrip | None
    below: bool
    width: float
    height: float
    margin_mm: float

    @property
    def largest_mm(self) -> float:
        """Side of the largest square that fits."""
        return min(self.room_mm[0] / self.width, self.room_mm[1] / self.height)

    def upper_left_mm(self, square_mm: float) -> tuple[float, float]:
        """Return where the board or its code begins, so that all stands in the middle."""
        room = self.room_mm
        return (
            self.margin_mm + (room[0] - self.width * square_mm) / 2,
            self.margin_mm + (room[1] - self.height * square_mm) / 2,
        )

    @property
    def room_mm(self) -> tuple[float, float]:
        """Width and height above the footer."""
        return self.page.width_mm - 2 * self.margin_mm, self.page.height_mm - 2 * self.margin_mm - self.footer.height_mm


def lay_out(board: Board, page: Page) -> Sheet:
    """Place a board on a page; one of unknown squares gets the largest that fit, in steps of 0.5 mm.

    `UsageError` where it does not fit, and for what cannot be printed.
    """
    _require_printable(board)
    no_code = obstacle(board if board.square_mm is not None else replace(board, square_mm=_SMALLEST_MM))
    best = max(_arrangements(board, page, coded=not no_code), key=lambda one: one.largest_mm)
    largest_mm = min(math.floor(best.largest_mm / _STEP_MM + _EXACT) * _STEP_MM, _LARGEST_MM)
    if largest_mm < _SMALLEST_MM and (board.square_mm is None or board.square > best.largest_mm):
        raise UsageError(
            f"board {board.name} on {page}: its squares would be under {_SMALLEST_MM:g} mm, give fewer squares or a larger page"
        )
    if board.square_mm is None:
        board = replace(board, square_mm=largest_mm)
    elif board.square > best.largest_mm + _EXACT:
        needed = tuple(2 * best.margin_mm + side * board.square for side in (best.width, best.height))
        raise UsageError(
            f"squares of {board.square:g} mm: board {board.name} would take {needed[0]:.1f} x "
            f"{needed[1] + best.footer.height_mm:.1f} mm of {page}, margins, code and bar included; at most "
            f"{best.largest_mm:.1f} mm fit, give --square-mm {largest_mm:g} or a larger page"
        )
    return _placed(board, best, no_code)


def _require_printable(board: Board) -> None:
    if board.kind == "charuco" and "h" in board.dictionary:
        raise UsageError(
            f"board {board.name}: AprilTags stand upside down in some releases of OpenCV, so a ChArUco board of them would be "
            "read by half of the world: give a dictionary like 4x4_100, or an aprilgrid"
        )


def _arrangements(board: Board, page: Page, *, coded: bool) -> Iterator[_Arrangement]:
    """Yield the ways to place a board on a page that leave room for it, the plainest first."""
    one = replace(board, square_mm=None)
    x0, y0, x1, y1 = board_frame(one, MARGIN if board.inverted else 0.0)
    width, height, module = x1 - x0, y1 - y0, module_share(board)
    for turned in page.turns:
        margin_mm = min(_MARGIN_MM, _MARGIN_SHARE * min(turned.width_mm, turned.height_mm))
        footer = Footer.of(board, turned.width_mm - 2 * margin_mm, coded=coded)
        found = [_Arrangement(turned, footer, None, below=True, width=width, height=height, margin_mm=margin_mm)]
        if coded:
            strips = [CodeStrip(range(PLACES), code_dictionary(board), per_row) for per_row in (10, 5, 4, 3, 2, 1)]
            found = [
                _Arrangement(
                    turned,
                    footer,
                    strip,
                    below=below,
                    width=max(width, strip.width * module) if below else width + MARGIN + strip.width * module,
                    height=height + MARGIN + strip.height * module if below else max(height, strip.height * module),
                    margin_mm=margin_mm,
                )
                for strip in strips
                for below in (True, False)
            ]
        yield from found


def _placed(board: Board, chosen: _Arrangement, no_code: str) -> Sheet:
    """Centre the board with its code in the room above the footer."""
    left, top = chosen.upper_left_mm(board.square)
    x0, y0, x1, y1 = board_frame(board, MARGIN if board.inverted else 0.0)
    code: Ink | None = None
    markers: tuple[int, ...] = ()
    origin = left - x0, top - y0
    if chosen.strip is not None:
        markers, module = encode(board), module_share(board) * board.square
        strip = replace(chosen.strip, markers=markers)
        wide, high, gap = strip.width * module, strip.height * module, MARGIN * board.square
        if chosen.below:
            middle = left + chosen.width * board.square / 2
            origin = middle - (x1 - x0) / 2 - x0, top - y0
            at = middle - wide / 2, top + y1 - y0 + gap
        else:
            middle = top + chosen.height * board.square / 2
            origin = left - x0, middle - (y1 - y0) / 2 - y0
            at = left + x1 - x0 + gap, middle - high / 2
        code = strip.ink().moved(*at, module)
    corner = chosen.margin_mm, chosen.page.height_mm - chosen.margin_mm - chosen.footer.height_mm
    footer = Footer.of(board, chosen.room_mm[0], coded=code is not None)
    return Sheet(
        page=chosen.page,
        board=board,
        board_at_mm=origin,
        pattern=board_ink(board).moved(*origin),
        code=code,
        bar=footer.bar(*corner),
        bar_mm=footer.bar_mm,
        lines=footer.lines(*corner),
        code_markers=markers,
        no_code=no_code,
    )
