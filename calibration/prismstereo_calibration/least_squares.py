"""Least squares of a few numbers with derivatives by small steps: for fits of a smooth model that starts close by."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["least_squares"]

Array = NDArray[np.float64]
_ROUNDS = 8


def least_squares(projected: Callable[[Array], Array], pixels: Array, start: Array, steps: Array) -> Array:
    """Bring projected(numbers) nearest to `pixels`, both (..., 2), from `start` (P,) on, by Gauss and Newton's method.

    `steps` (P,) are what the numbers are moved by for the derivatives. What the pixels do not determine stays as it was.
    """
    parameters = start
    for _ in range(_ROUNDS):
        here = projected(parameters).ravel()
        columns = [
            (projected(parameters + step * unit).ravel() - here) / step
            for step, unit in zip(steps, np.eye(len(start)), strict=True)
        ]
        jacobian = np.stack(columns, axis=1)
        scale = 1 / np.maximum(np.linalg.norm(jacobian, axis=0), np.finfo(float).tiny)  # a parameter that moves nothing
        change = np.linalg.lstsq(jacobian * scale, pixels.ravel() - here, rcond=1e-8)[0]
        parameters = parameters + scale * change
    return parameters
