"""A lens with k3 as one without: the eight numbers that come nearest over one view's picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.solving.projection import lens_of, numbers_of, project
from prismstereo_hw.lens import Lens

__all__ = ["without_k3"]

Array = NDArray[np.float64]
_GRID = 15
_ROUNDS = 10
_FREE = slice(0, 8)  # all but k3


def without_k3(lens: Lens, width: int, height: int) -> tuple[Lens, float]:
    """Return the lens with k3 = 0 that fits best over a picture of that size, and by how many px it is off at most."""
    if lens.distortion[4] == 0:
        return lens, 0.0
    columns, rows = np.meshgrid(np.linspace(0, width - 1, _GRID), np.linspace(0, height - 1, _GRID))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)
    slopes = lens.slopes(pixels)
    seen = np.isfinite(slopes).all(axis=-1)
    pixels, points = pixels[seen], np.column_stack([slopes[seen], np.ones(np.count_nonzero(seen))])
    numbers = numbers_of(lens)
    numbers[8] = 0.0
    for _ in range(_ROUNDS):
        here = project(numbers, points)
        moves = here.by_lens[..., _FREE].reshape(-1, 8)
        scale = 1 / np.maximum(np.linalg.norm(moves, axis=0), 1e-300)
        off = (pixels - here.pixels).ravel()
        numbers[_FREE] += scale * np.linalg.lstsq(moves * scale, off, rcond=1e-12)[0]
    worst = np.linalg.norm(project(numbers, points).pixels - pixels, axis=-1).max()
    return lens_of(numbers), float(worst)
