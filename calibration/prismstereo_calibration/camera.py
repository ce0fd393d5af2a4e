"""A virtual camera: the lens, and where it stands.

Frame of a calibration: the left virtual camera, x right, y down, z along its optical axis. Transforms are
target-from-source: X_camera = R X_left + t. Pixels are upright coordinates of the camera's view, see `hw.view`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.plate import Plate
from prismstereo_hw.lens import Lens

__all__ = ["Camera"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Camera:
    """A lens and its pose, R (3, 3) and t (3,) in the calibration's unit of length (mm, or board squares).

    Behind glass the pose is that of the paraxial pinhole, and rays come from points near it on the axis.
    """

    lens: Lens
    R_camera_from_left: Array
    t_camera_from_left: Array
    plate: Plate | None = None

    @classmethod
    def at_origin(cls, lens: Lens, plate: Plate | None = None) -> Camera:
        """Return the left camera itself."""
        return cls(lens, np.eye(3), np.zeros(3), plate)

    @property
    def centre(self) -> Array:
        """Pinhole (3,) in the left camera's frame."""
        return -self.R_camera_from_left.T @ self.t_camera_from_left

    def project(self, points: Array) -> Array:
        """Project points (..., 3) of the left camera's frame to pixels (..., 2); NaN behind the camera."""
        own = points @ self.R_camera_from_left.T + self.t_camera_from_left
        return self.lens.project(own) if self.plate is None else self.lens.project_slopes(self.plate.slopes(own))

    def directions(self, pixels: Array) -> Array:
        """Return the unit directions (..., 3), in the left camera's frame, in which pixels (..., 2) look."""
        return self.rays(pixels)[1]

    def rays(self, pixels: Array) -> tuple[Array, Array]:
        """Return the rays of pixels (..., 2) in the left camera's frame: a point (..., 3) on each, its unit direction."""
        slopes = self.lens.slopes(pixels)
        direction = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        origin = np.zeros_like(direction)
        if self.plate is not None:
            origin[..., 2] = self.plate.crossing_mm(slopes)
        return (origin - self.t_camera_from_left) @ self.R_camera_from_left, direction @ self.R_camera_from_left
