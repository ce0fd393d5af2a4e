"""The calibration board: a flat set of corners whose places on the board are known.

Three kinds. A *chessboard* is counted in INNER corners. A *ChArUco* board is a chessboard, counted in SQUARES, with a marker in
every white square: each corner has a name, so a part of the board is enough. An *AprilGrid* is a grid of tags, counted in TAGS,
with four corners each.

Board frame: origin in corner 0, x along a row of corners, y along a column, z away from the viewer who sees x to the
right and y down. Corner 0 of a chessboard or ChArUco board is its first inner corner, that of an AprilGrid the upper left
corner of its upper left tag. Lengths are millimetres, or squares where nobody said how large a square is.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Unit
from prismstereo_hw.errors import UsageError

__all__ = ["Board", "Kind"]

Kind = Literal["chessboard", "charuco", "aprilgrid"]
Grid = NDArray[np.float64]

_FEWEST, _MOST = 3, 64  # inner corners along a side: below 3 the detectors see boards everywhere
_FEWEST_TAGS = 2
_LARGEST_SQUARE_MM = 10_000.0
_FORM = re.compile(r"(?P<kind>[a-z]+):(?P<columns>\d{1,4})x(?P<rows>\d{1,4})(?P<rest>(:[a-z0-9_.]+)*)", re.ASCII)
_DICTIONARY = re.compile(r"[4-7]x[4-7]_(50|100|250|1000)|16h5|25h9|36h10|36h11")
_SHARE = {"chessboard": 0.0, "charuco": 0.75, "aprilgrid": 0.3}  # of a marker in its square; of a gap in its tag
_SIZES = (50, 100, 250, 1000)
_MEANT = "chessboard:9x6 (inner corners), charuco:11x8 (squares) or aprilgrid:6x6 (tags), columns x rows"


@dataclass(frozen=True, slots=True)
class Board:
    """A board by its counts, and the side of one square (of one tag for an AprilGrid); `UsageError` for an impossible one.

    `share`: side of a ChArUco marker, or gap between the tags of an AprilGrid, over `square_mm`; None for the usual one.
    `dictionary`: whose markers they are, e.g. `4x4_100`, `36h11`; "" for the usual one. `inverted`: white on black.
    """

    columns: int
    rows: int
    square_mm: float | None = None
    kind: Kind = "chessboard"
    share: float | None = None
    dictionary: str = ""
    inverted: bool = False

    def __post_init__(self) -> None:
        """Refuse boards that no detector finds and squares that nobody prints; fill in what is usual."""
        fewest = {"chessboard": _FEWEST, "charuco": _FEWEST + 1, "aprilgrid": _FEWEST_TAGS}[self.kind]
        if not (fewest <= self.columns <= _MOST and fewest <= self.rows <= _MOST):
            counted = {
                "chessboard": "inner corners each way (one less than there are squares)",
                "charuco": "squares each way",
                "aprilgrid": "tags each way",
            }[self.kind]
            raise UsageError(f"board {self.columns}x{self.rows}: give {fewest} to {_MOST} {counted}")
        square = self.square_mm
        if square is not None and not (math.isfinite(square) and 0 < square <= _LARGEST_SQUARE_MM):
            raise UsageError(f"a square of {square:g} mm: measure the printed board, and give its side in millimetres")
        self._fill_in()

    def _fill_in(self) -> None:
        share = _SHARE[self.kind] if self.share is None else self.share
        if self.kind != "chessboard" and not 0.05 <= share <= 0.95:
            raise UsageError(f"board {self.kind}: a share of {share:g} of the square: give one between 0.05 and 0.95")
        usual = {"chessboard": "", "charuco": _smallest(self.marker_count), "aprilgrid": "36h11"}[self.kind]
        dictionary = self.dictionary or usual
        if self.kind != "chessboard" and not _DICTIONARY.fullmatch(dictionary):
            raise UsageError(f"there is no marker dictionary {dictionary!r}: give one like 4x4_100, 5x5_1000 or 36h11")
        object.__setattr__(self, "share", share)
        object.__setattr__(self, "dictionary", dictionary)

    @classmethod
    def parse(cls, text: str, square_mm: float | None = None) -> Board:
        """Read `KIND:COLUMNSxROWS`, and what is unusual about the markers behind more colons, in any order.

        >>> Board.parse("chessboard:9x6", 25.0).columns
        9
        >>> Board.parse("charuco:4x5:4x4_1000:0.7:inverted").share
        0.7
        """
        form = _FORM.fullmatch(text.strip().lower())
        if form is None:
            raise UsageError(f"board {text!r} is not understood: write {_MEANT}")
        kind = next((known for known in get_args(Kind) if known == form["kind"]), None)
        if kind is None:
            raise UsageError(f"boards of kind {form['kind']!r} are not supported: write {_MEANT}")
        share, dictionary, inverted = None, "", False
        for word in form["rest"].split(":")[1:]:
            if word == "inverted":
                inverted = True
            elif kind != "chessboard" and _DICTIONARY.fullmatch(word):
                dictionary = word
            elif kind != "chessboard" and re.fullmatch(r"0?\.\d+", word):
                share = float(word)
            else:
                raise UsageError(
                    f"board {text!r}: {word!r} is not understood: a marker dictionary (4x4_100), a share (0.75) of the "
                    "square, or `inverted` may follow the size"
                )
        return cls(int(form["columns"]), int(form["rows"]), square_mm, kind, share, dictionary, inverted)

    @property
    def name(self) -> str:
        """How this board is written on the command line."""
        usual = Board(self.columns, self.rows, kind=self.kind)
        words = [f"{self.kind}:{self.columns}x{self.rows}"]
        words += [self.dictionary] * (self.dictionary != usual.dictionary)
        words += [f"{self.share:g}"] * (self.share != usual.share)
        words += ["inverted"] * self.inverted
        return ":".join(words)

    @property
    def unit(self) -> Unit:
        """The unit of every length that is measured with this board."""
        return "square" if self.square_mm is None else "mm"

    @property
    def square(self) -> float:
        """Side of a square, or of a tag, in `unit`."""
        return 1.0 if self.square_mm is None else self.square_mm

    @property
    def named_corners(self) -> bool:
        """Whether each corner can be told from the others, so that a part of the board is enough."""
        return self.kind != "chessboard"

    @property
    def marker_count(self) -> int:
        """How many markers are on the board: every white square of a ChArUco board, every tag of an AprilGrid."""
        squares = self.columns * self.rows
        return {"chessboard": 0, "charuco": squares // 2, "aprilgrid": squares}[self.kind]

    @property
    def corner_grid(self) -> tuple[int, int]:
        """Columns and rows of corners: all that there are, two each way to a tag."""
        times, less = {"chessboard": (1, 0), "charuco": (1, 1), "aprilgrid": (2, 0)}[self.kind]
        return times * self.columns - less, times * self.rows - less

    @property
    def corner_count(self) -> int:
        """Number of corners."""
        columns, rows = self.corner_grid
        return columns * rows

    def points(self) -> Grid:
        """Return the corners (N, 3) float64 in `unit`, row after row, z = 0."""
        columns, rows = self.corner_grid
        y, x = np.divmod(np.arange(columns * rows), columns)
        return np.stack([self._along(x), self._along(y), np.zeros(len(x))], axis=-1) * float(self.square)

    def _along(self, index: NDArray[np.intp]) -> Grid:
        """Return where corners stand along a side, in squares."""
        if self.kind != "aprilgrid":
            return index.astype(np.float64)
        tag, corner = np.divmod(index, 2)
        return tag * (1 + float(self.share or 0)) + corner


def _smallest(markers: int) -> str:
    """Name the smallest 4x4 dictionary that holds so many markers: the fewer there are, the fewer are mistaken."""
    return f"4x4_{next((size for size in _SIZES if size >= markers), _SIZES[-1])}"
