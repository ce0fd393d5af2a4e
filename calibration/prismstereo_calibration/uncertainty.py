"""How well the numbers of a calibration are known: one covariance for both cameras, whatever model they came from.

The 24 numbers are, in this order: fx, fy, cx, cy, k1, k2, p1, p2, k3 of the left lens, the same of the right one (upright
pixels), a turn of the right camera in radians (R <- exp(w) R) and a shift of it in the calibration's unit. What a model
keeps fixed has rows of zeros; what it shares between the lenses has equal rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError

__all__ = ["NUMBERS", "Uncertainty"]

Array = NDArray[np.float64]
_LENS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
NUMBERS = (
    *(f"left_{name}" for name in _LENS),
    *(f"right_{name}" for name in _LENS),
    *(f"turn_{axis}_rad" for axis in "xyz"),
    *(f"shift_{axis}" for axis in "xyz"),
)


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """The covariance (24, 24) of a calibration's numbers; `CalibrationError` for what is no covariance."""

    covariance: Array

    def __post_init__(self) -> None:
        """Refuse a matrix that no measurement leaves."""
        C = self.covariance
        if C.shape != (len(NUMBERS), len(NUMBERS)) or not np.isfinite(C).all():
            raise CalibrationError(f"covariance: give {len(NUMBERS)} x {len(NUMBERS)} finite numbers")
        scale = np.sqrt(np.maximum(np.diag(C), 0))
        if (np.diag(C) < 0).any() or (np.abs(C) > 1.000001 * np.outer(scale, scale) + 1e-300).any():
            raise CalibrationError("covariance: a correlation is beyond one, the file was damaged or written by hand")

    def sigma(self, name: str) -> float:
        """Return one standard deviation of a number by its name (see `NUMBERS`)."""
        index = NUMBERS.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def along(self, gradient: Array) -> Array:
        """Return one standard deviation (...) of something that moves with the numbers as `gradient` (..., 24) says."""
        variance = np.einsum("...i,ij,...j->...", gradient, self.covariance, gradient)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
