"""The one real lens: a pinhole with radial and tangential distortion, in pixels of the whole raw frame.

Model (Brown; the one OpenCV calls plumb bob): with a = X/Z, b = Y/Z, s = a^2 + b^2,
    a' = a (1 + k1 s + k2 s^2 + k3 s^3) + 2 p1 a b + p2 (s + 2 a^2)
    b' = b (1 + k1 s + k2 s^2 + k3 s^3) + p1 (s + 2 b^2) + 2 p2 a b
    x = fx a' + cx,  y = fy b' + cy.     Pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

__all__ = ["Lens"]

_UNDISTORT_ROUNDS = 20
_UNDISTORT_TOLERANCE = 1e-13
_UNDISTORT_MISS = 1e-9


@dataclass(frozen=True, slots=True)
class Lens:
    """Focal lengths and principal point in raw-frame pixels, and the distortion k1, k2, p1, p2, k3."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def K(self) -> NDArray[np.float64]:
        """The (3, 3) camera matrix."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    def distort(self, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bend ideal slopes (..., 2), X/Z and Y/Z, as this lens does."""
        k1, k2, p1, p2, k3 = self.distortion
        a, b = slopes[..., 0], slopes[..., 1]
        s = a * a + b * b
        radial = 1.0 + s * (k1 + s * (k2 + s * k3))
        return np.stack(
            [
                a * radial + 2 * p1 * a * b + p2 * (s + 2 * a * a),
                b * radial + p1 * (s + 2 * b * b) + 2 * p2 * a * b,
            ],
            axis=-1,
        )

    def undistort(self, bent: NDArray[np.float64]) -> NDArray[np.float64]:
        """Invert `distort` by Newton's method, to 1e-12; NaN where no slope of the one-to-one part comes out like that."""
        if not any(self.distortion):
            return bent.astype(np.float64)
        ideal = bent.astype(np.float64)
        with np.errstate(all="ignore"):  # beyond the fold the steps may run away: those end as NaN
            for _ in range(_UNDISTORT_ROUNDS):
                step = self._newton_step(ideal, self.distort(ideal) - bent)
                ideal = ideal - step
                if not np.nanmax(np.abs(step), initial=0.0) > _UNDISTORT_TOLERANCE:
                    break
            missed = np.max(np.abs(self.distort(ideal) - bent), axis=-1) > _UNDISTORT_MISS
            found = ~missed & self.one_to_one(ideal)
        return np.where(found[..., None], ideal, np.nan)

    def _newton_step(self, slopes: NDArray[np.float64], residual: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve the derivative of `distort`, a symmetric 2x2 matrix, for the residual."""
        k1, k2, p1, p2, k3 = self.distortion
        a, b = slopes[..., 0], slopes[..., 1]
        s = a * a + b * b
        radial = 1.0 + s * (k1 + s * (k2 + s * k3))
        growth = 2 * (k1 + s * (2 * k2 + s * 3 * k3))
        aa = radial + a * a * growth + 2 * p1 * b + 6 * p2 * a
        ab = a * b * growth + 2 * p1 * a + 2 * p2 * b
        bb = radial + b * b * growth + 6 * p1 * b + 2 * p2 * a
        ra, rb = residual[..., 0], residual[..., 1]
        return np.stack([bb * ra - ab * rb, aa * rb - ab * ra], axis=-1) / (aa * bb - ab * ab)[..., None]

    def one_to_one(self, slopes: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell where (...) the radial polynomial still rises at slopes (..., 2); beyond, it folds the far field back."""
        k1, k2, _, _, k3 = self.distortion
        # where 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3 is first 0; solved in 1/s, where the leading factor is never tiny
        turns = np.roots([1.0, 3 * k1, 5 * k2, 7 * k3]) if any((k1, k2, k3)) else np.zeros(0)
        steepest = max((float(turn.real) for turn in turns if abs(turn.imag) < 1e-12), default=0.0)
        fold = 1 / steepest if steepest > 0 else math.inf
        return np.asarray(np.sum(slopes**2, axis=-1) <= fold)  # NaN is nowhere

    def project_slopes(self, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take ideal slopes (..., 2) to pixels (..., 2)."""
        bent = self.distort(slopes)
        return np.asarray(bent * np.array([self.fx_px, self.fy_px]) + np.array([self.cx_px, self.cy_px]))

    def slopes(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take pixels (..., 2) to ideal slopes X/Z, Y/Z (..., 2); NaN where no ray comes to that pixel."""
        bent = (pixels - np.array([self.cx_px, self.cy_px])) / np.array([self.fx_px, self.fy_px])
        return self.undistort(bent)

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points (..., 3) of this lens' frame to pixels (..., 2); points behind the lens give NaN."""
        z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        return self.project_slopes(points[..., :2] / z[..., None])

    def scaled(self, factor: float) -> Lens:
        """Return this lens on a picture resized by `factor`: x becomes factor (x + 0.5) - 0.5."""
        return replace(
            self,
            fx_px=self.fx_px * factor,
            fy_px=self.fy_px * factor,
            cx_px=factor * (self.cx_px + 0.5) - 0.5,
            cy_px=factor * (self.cy_px + 0.5) - 0.5,
        )

    def mirrored(self, axis_px: float) -> Lens:
        """Return this lens seen in a picture mirrored left-right about the column `axis_px`."""
        k1, k2, p1, p2, k3 = self.distortion
        return replace(self, cx_px=2 * axis_px - self.cx_px, distortion=(k1, k2, p1, -p2, k3))
