"""A measured number and how far off it may be."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Measured"]


@dataclass(frozen=True, slots=True)
class Measured:
    """A value and one standard deviation of it, in mm or in the unit that the field's owner names.

    `sigma_mm` is made of `matching_mm`, what the noise of the matched disparities leaves, and `calibration_mm`, what the
    calibration itself does not know; None where it does not say, and then it is not in the sum.
    """

    value_mm: float
    sigma_mm: float
    matching_mm: float
    calibration_mm: float | None

    @classmethod
    def of(cls, value_mm: float, matching_mm: float, calibration_mm: float | None) -> Measured:
        """Add up both shares, which know nothing of each other."""
        return cls(value_mm, math.hypot(matching_mm, calibration_mm or 0.0), matching_mm, calibration_mm)
