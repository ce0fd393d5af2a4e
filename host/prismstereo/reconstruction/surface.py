"""The surface: what one frame shows, pixel by pixel, and how far along its ray each point may be off.

Frame: rectified left camera, x right, y down, z forward, in the calibration's unit (mm). depth = scale_px / inverse_px. Noise
is kept in pixels of disparity, where it is nearly the same all over a map, and told in mm where a point is made.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import FrameGeometry
from prismstereo.reconstruction.disparity_noise import disparity_sigma
from prismstereo.reconstruction.gates import Gates
from prismstereo.reconstruction.grid_kernels import place_points

__all__ = ["Surface"]

Float = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Disparity + offset (height, width) float32 px, glass considered, NaN where there is none, and one sigma of each, px.

    `left` is the rectified left picture, grey or BGR, or None; `filled` (height, width) bool: what was put into holes.
    """

    inverse_px: Float
    sigma_px: Float
    filled: NDArray[np.bool_]
    geometry: FrameGeometry
    left: NDArray[np.uint8] | None = None

    @classmethod
    def of(cls, frame: ExportFrame, gates: Gates | None = None) -> Surface:
        """Make the surface of a frame's matches that pass the gates; what a filter filled in is marked as filled."""
        disparity = frame.disparity
        found = frame.inverse_px
        sigma = disparity_sigma(disparity.disparity_px, disparity.confidence)
        filled = np.zeros(found.shape, bool) if disparity.filled is None else disparity.filled
        whole = cls(found, sigma, filled, frame.geometry, frame.left)
        return whole.only((gates or Gates()).keep(whole.depth))

    @property
    def depth(self) -> Float:
        """Depth along z (height, width) float32, NaN where there is none and beyond infinity."""
        ahead = self.inverse_px > 0  # NaN is not
        scale = np.float32(self.geometry.window.scale_px)
        return np.where(ahead, scale / np.where(ahead, self.inverse_px, np.float32(1)), np.float32(np.nan))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where there is a point (height, width)."""
        return np.isfinite(self.inverse_px)

    def only(self, kept: NDArray[np.bool_]) -> Surface:
        """Return the surface of chosen pixels (height, width)."""
        nothing = np.float32(np.nan)
        return replace(
            self,
            inverse_px=np.where(kept, self.inverse_px, nothing),
            sigma_px=np.where(kept, self.sigma_px, nothing),
            filled=self.filled & kept,
        )

    def points(self, pixels: NDArray[np.uint32]) -> tuple[Float, Float]:
        """Return the points (N, 3) float32 of pixels (N,), each counted as row * width + column, and their sigmas (N,).

        A sigma is one standard deviation along the ray, float32 in the unit.
        """
        made, count = self.geometry, len(pixels)
        points, sigmas = np.empty((count, 3), np.float32), np.empty(count, np.float32)
        pinhole = float(made.focal_px), float(made.cx_px), float(made.cy_px)
        inverse, noise = np.ascontiguousarray(self.inverse_px), np.ascontiguousarray(self.sigma_px)
        place_points(inverse, noise, pixels, pinhole, float(made.window.scale_px), 0, count, points, sigmas)
        return points, sigmas

    def colours(self, pixels: NDArray[np.uint32]) -> NDArray[np.uint8] | None:
        """Return the colours (N, 3) uint8 RGB of pixels (N,); None without a picture."""
        if self.left is None:
            return None
        if self.left.ndim == 2:
            return np.repeat(self.left.ravel()[pixels][:, None], 3, axis=1)
        return np.ascontiguousarray(self.left.reshape(-1, 3)[pixels][:, ::-1])
