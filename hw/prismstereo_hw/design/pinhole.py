"""The pinhole that stands best for a view behind a glass plate: what a calibration can make of it, and what it leaves.

A plate shifts each ray along the axis by delta(t), so the view is not quite a pinhole. A shift of the pinhole, a focal
length and two distortion terms take up most of it: u = v (a0 + a1 v^2 + a2 v^4), where u is the slope in the real lens and
v that of the straight line from the shifted pinhole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.optics.unfold import FoldedView

__all__ = ["PinholeView", "fit_pinhole"]

Array = NDArray[np.float64]
_ROUNDS = 6
_SLOPES = 24
_DEPTHS = 6


@dataclass(frozen=True, slots=True)
class PinholeView:
    """A calibrated view: R (3, 3) and centre (3,) in mm of the rig frame, and the factors a0, a1, a2."""

    R: Array
    centre_mm: Array
    factors: tuple[float, float, float]

    def directions(self, slopes: Array) -> Array:
        """Take slopes in the real lens (N, 2) to directions (N, 3) in the rig frame, not of unit length."""
        a0, a1, a2 = self.factors
        u = np.hypot(slopes[:, 0], slopes[:, 1])
        v = u / a0
        for _ in range(_ROUNDS):
            v = v - (v * (a0 + v * v * (a1 + v * v * a2)) - u) / (a0 + v * v * (3 * a1 + v * v * 5 * a2))
        ideal = slopes * (v / np.where(u > 0, u, 1.0))[:, None]
        return np.concatenate([ideal, np.ones((len(slopes), 1))], axis=1) @ self.R


def fit_pinhole(view: FoldedView, widest_slope: float, near_mm: float, far_mm: float) -> PinholeView:
    """Fit the pinhole to all slopes up to the widest, at depths evenly spaced in disparity; the pose is taken as known."""
    u, z = np.meshgrid(np.linspace(0, widest_slope, _SLOPES + 1)[1:], 1 / np.linspace(1 / near_mm, 1 / far_mm, _DEPTHS))
    cos_t = 1 / np.sqrt(1 + u * u)
    delta = view.plate_mm * (1 - cos_t / np.sqrt(view.index**2 - 1 + cos_t**2))
    radius = (z + view.paraxial_shift_mm - delta) * u  # z counts from the paraxial pinhole
    shift, factors = 0.0, np.array([1.0, 0.0, 0.0])
    for _ in range(_ROUNDS):
        v = radius / (z - shift)
        columns = np.stack([v, v**3, v**5, radius / (z - shift) ** 2 * (factors[0] + 3 * factors[1] * v**2)], axis=-1)
        *found, step = np.linalg.lstsq(columns.reshape(-1, 4), u.ravel(), rcond=None)[0]
        factors, shift = np.array(found), shift + float(step)
    centre = view.R.T @ (np.array([0.0, 0.0, view.paraxial_shift_mm + shift]) - view.t)
    return PinholeView(view.R, centre, (float(factors[0]), float(factors[1]), float(factors[2])))
