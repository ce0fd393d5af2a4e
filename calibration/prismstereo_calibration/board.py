"""The calibration board: a flat grid of corners whose places on the board are known.

Board frame: origin in the first inner corner, x along a row of corners, y along a column, z away from the viewer who
sees x to the right and y down. Lengths are millimetres, or squares where nobody said how large a square is.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Unit
from prismstereo_hw.errors import UsageError

__all__ = ["Board"]

_FEWEST, _MOST = 3, 64  # inner corners along a side: below 3 the detectors see boards everywhere
_LARGEST_SQUARE_MM = 10_000.0
_FORM = re.compile(r"(?P<kind>[a-z]+):(?P<columns>\d{1,4})x(?P<rows>\d{1,4})", re.ASCII)


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard by its INNER corners, and the side of one square; `UsageError` for one that cannot be."""

    columns: int
    rows: int
    square_mm: float | None = None
    kind: Literal["chessboard"] = "chessboard"

    def __post_init__(self) -> None:
        """Refuse boards that no detector finds and squares that nobody prints."""
        if not (_FEWEST <= self.columns <= _MOST and _FEWEST <= self.rows <= _MOST):
            raise UsageError(
                f"board {self.columns}x{self.rows}: give {_FEWEST} to {_MOST} inner corners each way "
                "(one less than there are squares)"
            )
        square = self.square_mm
        if square is not None and not (math.isfinite(square) and 0 < square <= _LARGEST_SQUARE_MM):
            raise UsageError(f"a square of {square:g} mm: measure the printed board, and give its side in millimetres")

    @classmethod
    def parse(cls, text: str, square_mm: float | None = None) -> Board:
        """Read `chessboard:COLUMNSxROWS`, counted in inner corners.

        >>> Board.parse("chessboard:9x6", 25.0).columns
        9
        """
        form = _FORM.fullmatch(text.strip().lower())
        if form is None:
            raise UsageError(f"board {text!r} is not understood: write chessboard:9x6 (inner corners, columns x rows)")
        if form["kind"] != "chessboard":
            raise UsageError(
                f"boards of kind {form['kind']!r} are not supported: use a plain chessboard, chessboard:COLUMNSxROWS"
            )
        return cls(int(form["columns"]), int(form["rows"]), square_mm)

    @property
    def name(self) -> str:
        """How this board is written on the command line."""
        return f"{self.kind}:{self.columns}x{self.rows}"

    @property
    def unit(self) -> Unit:
        """The unit of every length that is measured with this board."""
        return "square" if self.square_mm is None else "mm"

    @property
    def square(self) -> float:
        """Side of a square in `unit`."""
        return 1.0 if self.square_mm is None else self.square_mm

    @property
    def corner_count(self) -> int:
        """Number of inner corners."""
        return self.columns * self.rows

    def points(self) -> NDArray[np.float64]:
        """Return the inner corners (N, 3) float64 in `unit`, row after row, z = 0."""
        y, x = np.divmod(np.arange(self.corner_count), self.columns)
        return np.stack([x, y, np.zeros_like(x)], axis=-1) * float(self.square)
