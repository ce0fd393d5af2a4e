"""Plane surfaces with finite apertures: what every rig is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Surface", "strip"]

Array = NDArray[np.float64]
Action = Literal["refract", "reflect", "total"]


@dataclass(frozen=True, slots=True)
class Surface:
    """A rectangle in the rig frame that refracts, reflects, or reflects totally.

    `along` and `across` are unit vectors in the plane (3,); the rectangle reaches `half_along_mm` and `half_across_mm`
    from `centre_mm`. Indices are those before and after a refracting surface, and inside a totally reflecting one.
    """

    name: str
    action: Action
    centre_mm: Array
    along: Array
    across: Array
    half_along_mm: float
    half_across_mm: float
    index_before: float = 1.0
    index_after: float = 1.0

    @property
    def normal(self) -> Array:
        """Unit normal (3,)."""
        return np.cross(self.along, self.across)

    def reflection(self) -> tuple[Array, Array]:
        """Return A (3, 3) and b (3,) with X_reflected = A X + b."""
        n = self.normal
        return np.eye(3) - 2 * np.outer(n, n), 2 * n * float(n @ self.centre_mm)


def strip(
    name: str,
    action: Action,
    begin_xz_mm: tuple[float, float],
    end_xz_mm: tuple[float, float],
    height_mm: float,
    index_before: float = 1.0,
    index_after: float = 1.0,
) -> Surface:
    """Return the surface that stands on a line in the xz plane and reaches `height_mm` along y, half of it each way."""
    begin, end = np.array(begin_xz_mm, float), np.array(end_xz_mm, float)
    length = float(np.linalg.norm(end - begin))
    middle, along = (begin + end) / 2, (end - begin) / length
    return Surface(
        name,
        action,
        np.array([middle[0], 0.0, middle[1]]),
        np.array([along[0], 0.0, along[1]]),
        np.array([0.0, 1.0, 0.0]),
        length / 2,
        height_mm / 2,
        index_before,
        index_after,
    )
