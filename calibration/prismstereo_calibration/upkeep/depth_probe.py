"""What a change of pose does to depth: the same pixels, triangulated before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.upkeep.mount import Mount
from prismstereo_calibration.upkeep.sightlines import SceneMatches, Sightlines

__all__ = ["DepthProbe"]

Array = NDArray[np.float64]
_GRID = (15, 9)
_DEPTH_MM = 1000.0
_DEPTH_BASELINES = 20.0  # the same, where nobody knows how long a millimetre is
_STEP = 1e-2


@dataclass(frozen=True, slots=True)
class DepthProbe:
    """Pixel pairs of points at one depth, as the calibration has them; `ahead` (3,) is its rectified z axis."""

    lines: Sightlines
    depth: float
    ahead: Array

    @classmethod
    def of(cls, calibration: Calibration) -> DepthProbe:
        """Spread points over the common field at one metre, or at twenty baselines where lengths are in squares."""
        depth = _DEPTH_MM if calibration.unit == "mm" else _DEPTH_BASELINES * calibration.baseline
        ahead = np.asarray(rectification(calibration).left.R_rectified_from_left[2])
        frame = calibration.frame_width, calibration.frame_height
        x, y, _, _ = calibration.left_view.rectangle(*frame)
        w, h = calibration.left_view.upright_size(*frame)
        columns, rows = np.meshgrid(np.linspace(x, x + w - 1, _GRID[0]), np.linspace(y, y + h - 1, _GRID[1]))
        left_px = np.stack([columns.ravel(), rows.ravel()], axis=-1)
        origin, along = calibration.left.rays(left_px)
        points = origin + ((depth - origin @ ahead) / (along @ ahead))[:, None] * along
        right_px = calibration.right.project(points)
        x, y, _, _ = calibration.right_view.rectangle(*frame)
        w, h = calibration.right_view.upright_size(*frame)
        seen = np.all((right_px >= [x, y]) & (right_px <= [x + w - 1, y + h - 1]), axis=1)
        if not seen.any():
            raise CalibrationError(
                f"the two views share nothing at {depth:.4g} {calibration.unit}, so no depth can be held against it: "
                "calibrate again"
            )
        return cls(Sightlines.of(calibration, [SceneMatches("", left_px[seen], right_px[seen])]), depth, ahead)

    def change(self, R: Array, t: Array) -> float:
        """Return by what share of itself the depth grows if the right camera stands at R (3, 3), t (3,)."""
        return float(np.mean(1 / (self.lines.nearness(R, t, self.ahead) * self.depth)) - 1)

    def sigma(self, calibration: Calibration, mount: Mount, amounts: Array, covariance: Array) -> float:
        """Return one standard deviation of that share for a covariance (k, k) of a mount's amounts (k,)."""
        here = self.change(*mount.moved(calibration.right, amounts))
        gradient = np.array(
            [
                (self.change(*mount.moved(calibration.right, amounts + _STEP * unit)) - here) / _STEP
                for unit in np.eye(len(amounts))
            ]
        )
        return float(np.sqrt(gradient @ covariance @ gradient))
