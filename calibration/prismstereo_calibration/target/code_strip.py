"""The code beside a board, as ink: its markers in rows, in no order that matters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from prismstereo_calibration.target.ink import Ink
from prismstereo_calibration.target.marker_bits import dictionary, marker_bits

__all__ = ["CodeStrip"]


@dataclass(frozen=True, slots=True)
class CodeStrip:
    """Markers of a dictionary in rows of so many, one module of paper between them; lengths in modules.

    The modules are those of the board's own markers, so the code is read wherever the board is.
    """

    markers: Sequence[int]
    book: str
    per_row: int

    @property
    def pitch(self) -> int:
        """Modules from one marker to the next."""
        return int(dictionary(self.book).markerSize) + 3

    @property
    def width(self) -> int:
        """Modules along a row, from black to black."""
        return self.per_row * self.pitch - 1

    @property
    def height(self) -> int:
        """Modules down the rows, from black to black."""
        return -(-len(self.markers) // self.per_row) * self.pitch - 1

    def ink(self) -> Ink:
        """Return the ink in modules, the origin in the upper left corner."""
        book, squares = dictionary(self.book), []
        for index, number in enumerate(self.markers):
            row, column = divmod(index, self.per_row)
            y, x = np.nonzero(np.pad(marker_bits(book, number), 1, constant_values=True))
            corner = np.stack([x, y], axis=-1) + np.array([column, row]) * self.pitch
            squares.append(np.concatenate([corner, corner + 1], axis=-1))
        return Ink.of(np.concatenate(squares).astype(np.float64))
