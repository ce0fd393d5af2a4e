"""What the verdict on a calibration rests on: figures in three bands, each with its limits and with what it is worth in depth.

The limits. Corners of a good detector are off by 0.2 px per axis: that reads 0.28 px of rms, 0.23 px of row error and 0.001 of
length, and each limit leaves room above it. A depth uncertainty of half a per cent is that of a quarter pixel of disparity at
1 m, so a good calibration adds less than the matcher does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = [
    "Criterion",
    "Verdict",
    "coverage_criterion",
    "depth_criterion",
    "rms_criterion",
    "row_criterion",
    "scale_criterion",
    "views_criterion",
    "worst",
]

Verdict = Literal["good", "usable", "redo"]

_BANDS: tuple[Verdict, ...] = ("good", "usable", "redo")


@dataclass(frozen=True, slots=True)
class Criterion:
    """One figure that the verdict rests on: up to `good` it is good, up to `usable` it can be used.

    With `at_least` it is the other way round: down to. `length_per_unit` is what one of its unit is worth, as a length in the
    calibration's unit, at the distance at which figures are compared; None where it is no length.
    """

    name: str
    value: float
    good: float
    usable: float
    unit: str
    at_least: bool = False
    length_per_unit: float | None = None

    @property
    def band(self) -> Verdict:
        """The band this figure falls in; a figure that is not a number falls in the last."""
        sign = -1 if self.at_least else 1
        if sign * self.value <= sign * self.good:
            return "good"
        return "usable" if sign * self.value <= sign * self.usable else "redo"

    @property
    def lengths(self) -> tuple[float, float, float] | None:
        """The value and both limits as lengths; None where they are none."""
        worth = self.length_per_unit
        return None if worth is None else (self.value * worth, self.good * worth, self.usable * worth)


def worst(criteria: tuple[Criterion, ...]) -> Verdict:
    """Return the worst band among criteria."""
    return max((criterion.band for criterion in criteria), key=_BANDS.index)


def rms_criterion(rms_px: float, depth: float, scale_px: float) -> Criterion:
    """Judge the reprojection; `scale_px` is focal length times baseline, so a pixel of disparity is worth depth^2 over it."""
    return Criterion("reprojection rms", rms_px, 0.5, 1.0, "px", length_per_unit=depth**2 / scale_px)


def row_criterion(mean_px: float, depth: float, focal_px: float) -> Criterion:
    """Judge the rows; a pixel across is worth depth over focal length."""
    return Criterion("mean row error", mean_px, 0.4, 0.8, "px", length_per_unit=depth / focal_px)


def scale_criterion(error: float, depth: float) -> Criterion:
    """Judge the scale by the board's size: the error is a share of every length."""
    return Criterion("scale error", abs(error), 0.003, 0.01, "of the length", length_per_unit=depth)


def depth_criterion(sigma: float, depth: float) -> Criterion:
    """Judge what the calibration itself leaves open of a depth, one standard deviation, in per cent of it."""
    return Criterion("depth uncertainty", 100 * sigma / depth, 0.5, 2.0, "% of depth", length_per_unit=depth / 100)


def coverage_criterion(side: str, share: float) -> Criterion:
    """Judge how much of a view's common field had corners in it: a third holds the distortion down, a sixth hardly."""
    return Criterion(f"coverage, {side} view", share, 0.33, 0.16, "of the cells", at_least=True)


def views_criterion(count: int) -> Criterion:
    """Judge the number of views: with fewer than six, one that is bad can hardly be told from the others."""
    return Criterion("views", float(count), 6.0, 3.0, "frames", at_least=True)
