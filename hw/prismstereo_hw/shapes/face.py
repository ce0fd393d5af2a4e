"""The heights of a face that speaks: smooth bumps on a smooth head, the mouth opening and the brows rising with time.

Seen from the front: x to the viewer's right, y up, z towards the viewer, the middle of the head at the origin. Numbers are
those of a head of 210 mm; other sizes are scaled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from prismstereo_hw.shapes.shape import Array

__all__ = ["Face"]

_HEAD_MM = 210.0
_HALF_MM = (88.0, 122.0)  # of the sheet
_SKULL_MM = (66.0, 92.0, 70.0)  # half width and half height where it has fallen to 1/e, and depth
_SKULL_SLOPE = 4 * math.pow(0.75, 0.75) * math.exp(-0.75)  # the largest slope of exp(-r^4)
_BUMP_SLOPE = math.exp(-0.5)  # and of exp(-r^2 / 2)


class _Bump(NamedTuple):
    """A Gaussian: middle, widths (standard deviations) and height, mm."""

    x: float
    y: float
    wide: float
    tall: float
    height: float


@dataclass(frozen=True, slots=True)
class Face:
    """A face `head_mm` high that opens and shuts its mouth every `period_s`, shut at time 0.

    `mouth_mm` is how deep the open mouth is, `jaw_mm` how far lower lip and chin go down with it, `brow_lift_mm` how far the
    brows go up, all for a head of 210 mm. `seconds` is the time it is at.
    """

    head_mm: float = _HEAD_MM
    mouth_mm: float = 16.0
    jaw_mm: float = 10.0
    brow_lift_mm: float = 4.0
    period_s: float = 2.0
    seconds: float = 0.0

    @property
    def half_x_mm(self) -> float:
        """Half the width of the sheet."""
        return self._scale * _HALF_MM[0]

    @property
    def half_y_mm(self) -> float:
        """Half the height of the sheet."""
        return self._scale * _HALF_MM[1]

    @property
    def _scale(self) -> float:
        return self.head_mm / _HEAD_MM

    @property
    def opening(self) -> float:
        """How far the mouth is open: 0 to 1."""
        return 0.5 - 0.5 * math.cos(2 * math.pi * self.seconds / self.period_s)

    def at(self, seconds: float) -> Face:
        """Return the face some seconds later."""
        return replace(self, seconds=self.seconds + seconds)

    def _bumps(self) -> tuple[_Bump, ...]:
        open_ = self.opening
        brow, down = 38 + self.brow_lift_mm * open_, self.jaw_mm * open_
        pairs = [
            (_Bump(side * 24, brow, 20, 8, 7), _Bump(side * 23, 23, 12, 9, -8), _Bump(side * 34, -14, 17, 17, 8))
            for side in (-1, 1)  # brow, eye, cheek
        ]
        return (
            *pairs[0],
            *pairs[1],
            _Bump(0, 8, 8, 22, 14),  # bridge of the nose
            _Bump(0, -12, 10, 9, 14),  # its tip
            _Bump(0, -33, 19, 5, 4),  # upper lip
            _Bump(0, -41 - down / 2, 17, 3 + 0.7 * down, -2 - self.mouth_mm * open_),  # mouth
            _Bump(0, -48 - down, 17, 5, 5),  # lower lip
            _Bump(0, -70 - down, 18, 13, 9),  # chin
        )

    def height(self, x_mm: Array, y_mm: Array) -> Array:
        """Return z (N,) in mm at x, y (N,)."""
        x, y = x_mm / self._scale, y_mm / self._scale
        a, b, depth = _SKULL_MM
        z = depth * np.exp(-(((x / a) ** 2 + (y / b) ** 2) ** 2))
        for bump in self._bumps():
            z += bump.height * _bell(x, y, bump)
        return np.asarray(self._scale * z)

    def gradient(self, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
        """Return dz/dx and dz/dy, (N,) each, at x, y (N,)."""
        x, y = x_mm / self._scale, y_mm / self._scale
        a, b, depth = _SKULL_MM
        square = (x / a) ** 2 + (y / b) ** 2
        fall = -4 * depth * square * np.exp(-(square**2))
        by_x, by_y = fall * x / a**2, fall * y / b**2
        for bump in self._bumps():
            bell = bump.height * _bell(x, y, bump)
            by_x -= bell * (x - bump.x) / bump.wide**2
            by_y -= bell * (y - bump.y) / bump.tall**2
        return by_x, by_y

    def limits_mm(self) -> tuple[float, float]:
        """Return bounds below and above every height."""
        heights = [bump.height for bump in self._bumps()]
        low, high = sum(min(h, 0) for h in heights), _SKULL_MM[2] + sum(max(h, 0) for h in heights)
        return self._scale * low, self._scale * high

    def steepest(self) -> float:
        """Return a bound on the length of the gradient: that of every part added up."""
        parts = [abs(bump.height) / min(bump.wide, bump.tall) for bump in self._bumps()]
        return _SKULL_SLOPE * _SKULL_MM[2] / min(_SKULL_MM[:2]) + _BUMP_SLOPE * sum(parts)


def _bell(x: Array, y: Array, bump: _Bump) -> Array:
    return np.asarray(np.exp(-(((x - bump.x) / bump.wide) ** 2 + ((y - bump.y) / bump.tall) ** 2) / 2))
