"""What a scene asks of the things in it.

Everything is in the rig frame (see `scene`), millimetres and seconds. A shape is frozen: `at` gives the shape as it stands
later, and at(a).at(b) is at(a + b).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["NEAREST_MM", "Array", "Shape"]

Array = NDArray[np.float64]
NEAREST_MM = 1e-6  # what a ray starts on, it does not meet


class Shape(Protocol):
    """A textured thing that rays can meet."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    def at(self, seconds: float) -> Shape:
        """Return this shape as it stands some seconds later."""
        ...

    def distance(self, origin: Array, direction: Array) -> Array:
        """Return how far along each ray (N, 3), of unit direction, this is met first: (N,) mm, inf where it is not."""
        ...

    def shade(self, point: Array, pixel_mm: Array) -> Array:
        """Return grey levels (N,) at points (N, 3) of this surface, seen by pixels of a size (N,) in mm."""
        ...

    def normals(self, point: Array) -> Array:
        """Return unit normals (N, 3) at points (N, 3) of this surface: outward, or of either sign for a sheet."""
        ...
