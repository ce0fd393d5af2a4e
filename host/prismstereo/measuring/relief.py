"""The relief: the metric surface that one disparity map shows, ready to be measured.

Frame: rectified left camera, x right, y down, z forward, mm. A depth is `scale_px / inverse_px`. Noise is nearly the same all
over a map when it is counted in disparity, and a plane is linear in it; so fits are made there, and told in mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import FrameGeometry, Geometries
from prismstereo.measuring.patch import Patch
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.errors import UsageError

__all__ = ["Relief"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Relief:
    """Disparity + offset (height, width) float64 px, NaN where nothing was matched, and the pinhole it is seen through.

    What a filter filled in is not measured: it counts as unmatched.
    """

    inverse_px: Array
    geometry: FrameGeometry

    @classmethod
    def of(cls, disparity: DisparityMap, geometries: Geometries) -> Relief:
        """Make the relief of a map; `DataError` where it is none of the calibration's, `UsageError` without millimetres."""
        return cls.of_frame(ExportFrame.of(0, 0, disparity, None, geometries))

    @classmethod
    def of_frame(cls, frame: ExportFrame) -> Relief:
        """Make the relief of a frame; `UsageError` where its calibration counts in squares of unknown size."""
        if frame.geometry.unit != "mm":
            raise UsageError(
                "this calibration counts in squares of a board that nobody measured, so nothing is known in mm: calibrate with "
                "--square-mm"
            )
        found = frame.inverse_px.astype(np.float64)
        dropped = found <= 0
        if frame.disparity.filled is not None:
            dropped |= frame.disparity.filled
        return cls(np.where(dropped, np.nan, found), frame.geometry)

    @property
    def scale_px(self) -> float:
        """Focal length times baseline: depth times disparity, px mm."""
        return self.geometry.window.scale_px

    @property
    def whole(self) -> Patch:
        """The patch that is the whole map."""
        height, width = self.inverse_px.shape
        return Patch(0, 0, width, height)

    def rays(self, columns: Array, rows: Array) -> Array:
        """Return the directions (..., 3) in which pixels look, z one."""
        made = self.geometry
        x, y = (columns - made.cx_px) / made.focal_px, (rows - made.cy_px) / made.focal_px
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def pixels(self, patch: Patch, most: int | None = None) -> tuple[Array, Array, Array, int]:
        """Return columns, rows and disparities + offset (N,) of the matched pixels of a patch, and how many there are.

        With `most`, so many of them at the most, evenly chosen.
        """
        inside = self.inverse_px[patch.y : patch.bottom, patch.x : patch.right]
        matched = np.flatnonzero(np.isfinite(inside))
        count = len(matched)
        if most is not None and count > most:
            matched = matched[np.linspace(0, count - 1, most).astype(np.intp)]
        rows, columns = np.divmod(matched, patch.width)
        return (columns + patch.x).astype(float), (rows + patch.y).astype(float), inside[rows, columns], count

    def points(self, patch: Patch) -> Array:
        """Return the points (N, 3) mm of the matched pixels of a patch."""
        columns, rows, inverse, _ = self.pixels(patch)
        return np.asarray(self.rays(columns, rows) * (self.scale_px / inverse)[:, None])

    def require_inside(self, patch: Patch) -> None:
        """Refuse a patch that reaches out of the map."""
        height, width = self.inverse_px.shape
        if patch.x < 0 or patch.y < 0 or patch.right > width or patch.bottom > height:
            raise UsageError(
                f"{patch} reaches out of the map of {width}x{height}: give pixels of the rectified left picture"
            )
