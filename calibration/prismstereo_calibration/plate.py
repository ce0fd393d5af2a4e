"""The glass before a view: one total reflection in an equilateral prism unfolds to a plane-parallel plate.

The plate stands square to the optical axis and is the same for both views, so it adds no unknown: its thickness is the
prism's height and its index is in the data sheet. It moves the pinhole along the axis the further, the steeper a ray
comes in, so a view behind glass is not quite a pinhole (reference: optics, section 2, unfolding).

Frame: that of the view's camera, origin in the paraxial pinhole. With t the angle from the axis, u = tan t and
r = sqrt(n^2 + (n^2 - 1) u^2), a ray of slope u crosses the axis s(u) = h / n - h / r beyond the origin, and a point at
distance R from the axis and depth Z is seen at the u for which (Z - h / n) u + h u / r = R.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError

__all__ = ["Plate"]

Array = NDArray[np.float64]
_NEWTON_ROUNDS = 12
_NEWTON_TOLERANCE = 1e-14
_ON_AXIS = 1e-9  # slope below which a point is taken to be on the axis


@dataclass(frozen=True, slots=True)
class Plate:
    """A plane-parallel plate: thickness in mm and refractive index; `CalibrationError` for what is no glass."""

    thickness_mm: float
    index: float

    def __post_init__(self) -> None:
        """Refuse what cannot stand before a lens."""
        if not (math.isfinite(self.thickness_mm) and 0 < self.thickness_mm <= 1000):
            raise CalibrationError(f"a glass plate of {self.thickness_mm:g} mm: give 0 to 1000 mm")
        if not 1 < self.index <= 4:
            raise CalibrationError(f"a glass plate of refractive index {self.index:g}: give one between 1 and 4")

    def admits(self, slopes: Array) -> NDArray[np.bool_]:
        """Tell which slopes (..., 2) come through: beyond asin(n sin(60 - asin(1 / n))) the prism no longer reflects them."""
        sine = self.index * math.sin(math.radians(60) - math.asin(1 / self.index))
        steepest = math.inf if sine >= 1 else math.tan(math.asin(max(sine, 0.0)))
        return np.asarray(np.abs(slopes[..., 0]) <= steepest)

    def slopes(self, points: Array) -> Array:
        """Return the slopes (..., 2) at which points (..., 3) are seen; NaN behind the pinhole."""
        return self.seen(points)[0]

    def seen(self, points: Array) -> tuple[Array, Array]:
        """Return the slopes (..., 2) at which points (..., 3) are seen, and how they move with the points (..., 2, 3)."""
        X, Y, Z = points[..., 0], points[..., 1], points[..., 2]
        n2, h = self.index**2, self.thickness_mm
        radius = np.hypot(X, Y)
        depth = np.where(Z > 0, Z, np.nan)
        reduced = depth - h / self.index
        u = radius / depth
        for _ in range(_NEWTON_ROUNDS):
            root = np.sqrt(n2 + (n2 - 1) * u * u)
            step = (reduced * u + h * u / root - radius) / (reduced + h * n2 / root**3)
            u = u - step
            if not np.max(np.abs(step), initial=0.0, where=np.isfinite(step)) > _NEWTON_TOLERANCE:
                break
        steepness = reduced + h * n2 / np.sqrt(n2 + (n2 - 1) * u * u) ** 3
        off_axis = radius > _ON_AXIS * np.abs(Z)
        safe = np.where(off_axis, radius, 1.0)
        scale = np.where(off_axis, u / safe, 1 / depth)  # of X and Y, to their slopes
        growth = np.where(off_axis, (1 / steepness - scale) / safe**2, 0.0)  # d scale / d radius, over radius
        sink = np.where(off_axis, -u / steepness / safe, -scale / steepness)  # d scale / d Z
        moves = np.empty((*X.shape, 2, 3))
        moves[..., 0, 0], moves[..., 1, 1] = scale + growth * X * X, scale + growth * Y * Y
        moves[..., 0, 1] = moves[..., 1, 0] = growth * X * Y
        moves[..., 0, 2], moves[..., 1, 2] = sink * X, sink * Y
        return np.stack([X * scale, Y * scale], axis=-1), moves

    def crossing_mm(self, slopes: Array) -> Array:
        """Return where on the axis (...), from the paraxial pinhole, the rays of slopes (..., 2) seem to come from."""
        n2 = self.index**2
        root = np.sqrt(n2 + (n2 - 1) * np.sum(slopes**2, axis=-1))
        return np.asarray(self.thickness_mm * (1 / self.index - 1 / root))
