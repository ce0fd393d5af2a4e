"""The name tag of a board: ten markers that say which board it is and how large its squares are.

A marker's number is 100 times its place plus a digit of 0..96, so they may stand in any order and be gathered from many
pictures. Six digits carry the board, four are the values of the same polynomial (degree 5, modulo 97) at four more places:
any six determine the others. Eight must be seen. Of all ten up to four may be misread, and of eight up to two, and the code is
refused for certain, never taken for another board's.

The markers are of a dictionary that the board has not: 5x5_1000, or 6x6_1000 beside a board of 5x5 markers.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import get_args

from prismstereo_calibration.boards.board import Board, Kind
from prismstereo_hw.errors import UsageError

__all__ = ["CODE_DICTIONARIES", "LEAST", "PLACES", "code_dictionary", "decode", "encode", "obstacle", "place_and_digit"]

PLACES = 10
LEAST = 8  # places that must agree: two more than determine the rest, so that a misread marker does not
CODE_DICTIONARIES = ("5x5_1000", "6x6_1000")

_PRIME = 97
_WORDS = 6
_STEP = 100
_MASKS = (17, 48, 79, 13, 44, 75, 9, 40, 71, 5)  # so that no run of small marker numbers is a code
_KINDS: tuple[Kind, ...] = get_args(Kind)
_BOOKS = (
    *(f"{n}x{n}_{size}" for n in (4, 5, 6, 7) for size in (50, 100, 250, 1000)),
    *("16h5", "25h9", "36h10", "36h11"),
)  # the order is part of the code: new names go to the end
_TENTHS = (10, 9999)  # side of a square, in tenths of a millimetre
_COUNTS = (2, 64)
_PERCENT = (5, 95)
_SIZES = _TENTHS[1] - _TENTHS[0] + 1
_SIDES = _COUNTS[1] - _COUNTS[0] + 1
_SHARES = _PERCENT[1] - _PERCENT[0] + 1
_MARKED = _SHARES * len(_BOOKS)  # ways in which the markers of one kind of board can be


def obstacle(board: Board) -> str:
    """Say why a board has no code; empty where it has one."""
    square = board.square_mm
    if square is None:
        return "nobody said how large a square is"
    tenths = round(10 * square)
    if abs(10 * square - tenths) > 1e-6 or not _TENTHS[0] <= tenths <= _TENTHS[1]:
        return f"squares of {square:g} mm: the code knows 1 to 999.9 mm in steps of 0.1 mm"
    percent = 100 * float(board.share or 0)
    if board.kind != "chessboard" and abs(percent - round(percent)) > 1e-6:
        return f"a share of {board.share:g}: the code knows steps of 0.01"
    if board.kind != "chessboard" and board.dictionary not in _BOOKS:
        return f"markers of {board.dictionary}: the code knows {', '.join(_BOOKS)}"
    return ""


def code_dictionary(board: Board) -> str:
    """Name the dictionary of the code's markers."""
    return CODE_DICTIONARIES[board.dictionary.startswith("5x5")]


def encode(board: Board) -> tuple[int, ...]:
    """Return the ten marker numbers that name a board; `UsageError` where it has no code (see `obstacle`)."""
    why = obstacle(board)
    if why:
        raise UsageError(f"board {board.name} has no code: {why}")
    number, words = _number(board), {}
    for place in range(_WORDS):
        number, words[place] = divmod(number, _PRIME)
    return tuple(
        place * _STEP + (_at(words, place) + mask) % _PRIME for place, mask in zip(range(PLACES), _MASKS, strict=True)
    )


def place_and_digit(marker: int) -> tuple[int, int] | None:
    """Split a marker number; None for one that no code has."""
    place, digit = divmod(marker, _STEP)
    return (place, digit) if 0 <= place < PLACES and digit < _PRIME else None


def decode(markers: Collection[int], dictionary: str) -> Board | None:
    """Return the board that markers of a code dictionary name, or None.

    Up to two may be missing, and of a place that claims two digits neither counts; but not one of the rest may be wrong.
    """
    claims: dict[int, set[int]] = {}
    for place, digit in filter(None, map(place_and_digit, markers)):
        claims.setdefault(place, set()).add((digit - _MASKS[place]) % _PRIME)
    sure = {place: next(iter(digits)) for place, digits in sorted(claims.items()) if len(digits) == 1}
    if len(sure) < LEAST:
        return None
    words = dict(list(sure.items())[:_WORDS])
    if any(_at(words, place) != digit for place, digit in sure.items()):
        return None
    board = _board(sum(_at(words, place) * _PRIME**place for place in range(_WORDS)))
    return board if board is not None and code_dictionary(board) == dictionary else None


def _at(words: Mapping[int, int], place: int) -> int:
    """Return the value at a place of the polynomial through the words (Lagrange), modulo the prime."""
    total = 0
    for own, value in words.items():
        above, below = value, 1
        for other in words:
            if other != own:
                above, below = above * (place - other) % _PRIME, below * (own - other) % _PRIME
        total += above * pow(below, -1, _PRIME)
    return total % _PRIME


def _number(board: Board) -> int:
    """Return the board as one number, in mixed radix."""
    look = 0
    if board.kind != "chessboard":
        percent = round(100 * float(board.share or 0)) - _PERCENT[0]
        marks = percent * len(_BOOKS) + _BOOKS.index(board.dictionary)
        look = 1 + (_KINDS.index(board.kind) - 1) * _MARKED + marks
    number = look * 2 + board.inverted
    number = number * _SIDES + board.columns - _COUNTS[0]
    number = number * _SIDES + board.rows - _COUNTS[0]
    return number * _SIZES + round(10 * board.square) - _TENTHS[0]


def _board(number: int) -> Board | None:
    """Return the board behind a number, or None where there is none."""
    number, tenths = divmod(number, _SIZES)
    number, rows = divmod(number, _SIDES)
    number, columns = divmod(number, _SIDES)
    look, inverted = divmod(number, 2)
    if look > (len(_KINDS) - 1) * _MARKED:
        return None
    kind, share, book = _KINDS[0], None, ""
    if look:
        kind_index, marks = divmod(look - 1, _MARKED)
        percent, book_index = divmod(marks, len(_BOOKS))
        kind, share, book = _KINDS[kind_index + 1], (percent + _PERCENT[0]) / 100, _BOOKS[book_index]
    counts = columns + _COUNTS[0], rows + _COUNTS[0]
    try:
        return Board(*counts, (tenths + _TENTHS[0]) / 10, kind, share, book, bool(inverted))
    except UsageError:  # counts that no board of this kind has
        return None
