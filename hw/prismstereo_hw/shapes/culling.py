"""Which rays come near a thing at all: most do not, and need not be turned into its frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.shapes.shape import Array

__all__ = ["among_passing", "passing"]

_SLACK = 1e-9  # of the squares: rounding must not lose a ray


def passing(origin: Array, direction: Array, centre_mm: Array, radius_mm: float) -> NDArray[np.intp]:
    """Return the indices of rays (N, 3) of unit direction that may meet a ball, centre (3,), somewhere ahead."""
    to_centre = centre_mm - origin
    along = np.einsum("ni,ni->n", to_centre, direction)
    square = np.einsum("ni,ni->n", to_centre, to_centre)
    aside = square - along * along
    return np.flatnonzero((aside <= radius_mm**2 + _SLACK * (square + radius_mm**2)) & (along >= -1.0001 * radius_mm))


def among_passing(
    origin: Array, direction: Array, centre_mm: Array, radius_mm: float, distance: Callable[[Array, Array], Array]
) -> Array:
    """Return what `distance` says of the rays (N, 3) that pass near a ball, and inf for all others: (N,) mm."""
    near = passing(origin, direction, centre_mm, radius_mm)
    reach = np.full(len(direction), np.inf)
    if near.size:
        reach[near] = distance(origin[near], direction[near])
    return reach
