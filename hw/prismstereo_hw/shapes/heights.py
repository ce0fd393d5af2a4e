"""Heights over a rectangle: a grid of numbers, smoothly joined, and what every kind of heights can tell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from prismstereo_hw.errors import UsageError
from prismstereo_hw.shapes.shape import Array

__all__ = ["GridHeights", "Heights"]

_STEEPEST = 1.5 * 1.25  # slope of a Catmull-Rom surface over its largest step: 1.5 along, 1.25 by the weights across
_HIGHEST = 1.25**2  # and how far its values spread, over the grid's


class Heights(Protocol):
    """z = f(x, y) in mm over |x| <= half_x_mm, |y| <= half_y_mm, with a continuous gradient; may change with time."""

    @property
    def half_x_mm(self) -> float:
        """Half the width of the rectangle."""
        ...

    @property
    def half_y_mm(self) -> float:
        """Half its height."""
        ...

    def at(self, seconds: float) -> Heights:
        """Return the heights as they are some seconds later."""
        ...

    def height(self, x_mm: Array, y_mm: Array) -> Array:
        """Return z (N,) in mm at x, y (N,)."""
        ...

    def gradient(self, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
        """Return dz/dx and dz/dy, (N,) each, at x, y (N,)."""
        ...

    def limits_mm(self) -> tuple[float, float]:
        """Return bounds below and above every height."""
        ...

    def steepest(self) -> float:
        """Return a bound on the length of the gradient."""
        ...


@dataclass(frozen=True, slots=True)
class GridHeights:
    """Heights given on a grid (rows, columns) in mm, row 0 at y = -half_y_mm, joined by Catmull-Rom splines (C1).

    `UsageError` for a grid with a side below 2, or with numbers that are not finite.
    """

    grid_mm: Array
    half_x_mm: float
    half_y_mm: float

    def __post_init__(self) -> None:
        """Refuse what is no surface."""
        if self.grid_mm.ndim != 2 or min(self.grid_mm.shape) < 2 or not np.isfinite(self.grid_mm).all():
            raise UsageError(f"a height grid of shape {self.grid_mm.shape}: give at least 2 x 2 finite numbers in mm")

    def at(self, seconds: float) -> GridHeights:
        """Return the same heights: a grid is at rest."""
        del seconds
        return self

    def _spacing(self) -> tuple[float, float]:
        rows, columns = self.grid_mm.shape
        return 2 * self.half_x_mm / (columns - 1), 2 * self.half_y_mm / (rows - 1)

    def _padded(self) -> Array:
        return np.pad(self.grid_mm, 1, mode="reflect", reflect_type="odd")  # goes on straight beyond the rim

    def _patch(self, x_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """Return the 4 x 4 grid values around each point (N, 4, 4) and the place (N,), (N,) within the cell, 0..1."""
        dx, dy = self._spacing()
        rows, columns = self.grid_mm.shape
        padded = self._padded()
        across, down = (x_mm + self.half_x_mm) / dx, (y_mm + self.half_y_mm) / dy
        column = np.clip(np.floor(across).astype(np.intp), 0, columns - 2)
        row = np.clip(np.floor(down).astype(np.intp), 0, rows - 2)
        span = np.arange(4)
        values = padded[(row[:, None] + span)[:, :, None], (column[:, None] + span)[:, None, :]]
        return values, across - column, down - row

    def height(self, x_mm: Array, y_mm: Array) -> Array:
        """Return z (N,) in mm at x, y (N,)."""
        values, s, t = self._patch(x_mm, y_mm)
        return np.asarray(np.einsum("nij,ni,nj->n", values, _weights(t), _weights(s), optimize=False))

    def gradient(self, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
        """Return dz/dx and dz/dy, (N,) each, at x, y (N,)."""
        values, s, t = self._patch(x_mm, y_mm)
        dx, dy = self._spacing()
        by_x = np.einsum("nij,ni,nj->n", values, _weights(t), _slopes(s), optimize=False) / dx
        by_y = np.einsum("nij,ni,nj->n", values, _slopes(t), _weights(s), optimize=False) / dy
        return by_x, by_y

    def limits_mm(self) -> tuple[float, float]:
        """Return bounds below and above every height."""
        padded = self._padded()
        low, high = float(padded.min()), float(padded.max())
        reach = _HIGHEST * (high - low) / 2
        return (low + high) / 2 - reach, (low + high) / 2 + reach

    def steepest(self) -> float:
        """Return a bound on the length of the gradient."""
        dx, dy = self._spacing()
        along, across = (float(np.abs(np.diff(self._padded(), axis=axis)).max()) for axis in (1, 0))
        return _STEEPEST * math.hypot(along / dx, across / dy)


def _weights(t: Array) -> Array:
    """Return the four Catmull-Rom weights (N, 4) at places t (N,) between the middle two."""
    return np.stack(
        [
            t * (-1 + t * (2 - t)) / 2,
            (2 + t * t * (-5 + 3 * t)) / 2,
            t * (1 + t * (4 - 3 * t)) / 2,
            t * t * (t - 1) / 2,
        ],
        axis=-1,
    )


def _slopes(t: Array) -> Array:
    """Return the derivatives of `_weights` by t."""
    return np.stack(
        [
            (-1 + t * (4 - 3 * t)) / 2,
            t * (-10 + 9 * t) / 2,
            (1 + t * (8 - 9 * t)) / 2,
            t * (3 * t - 2) / 2,
        ],
        axis=-1,
    )
