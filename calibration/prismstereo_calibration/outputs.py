"""The other pictures a camera can deliver, and where a pixel of the calibrated frame lies in each of them.

A camera gives its video from a crop of the sensor, resized; stills from another crop, at another scale. Both are the same lens,
so one scale and one shift lead from the calibrated frame to any of them: x_output = scale * x + shift, y alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Output"]


@dataclass(frozen=True, slots=True)
class Output:
    """One output of the camera: name, size in pixels, and the way there from a pixel (x, y) of the calibrated frame.

    `rms_px` is what the board's corners left over, in pixels of this output; None where it was not measured.
    """

    name: str
    width: int
    height: int
    scale: float
    shift_x_px: float
    shift_y_px: float
    rms_px: float | None = None

    def from_calibrated(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take raw-frame pixels (..., 2) of the calibrated mode to pixels of this output."""
        return np.asarray(pixels * self.scale + np.array([self.shift_x_px, self.shift_y_px]))

    def to_calibrated(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take pixels (..., 2) of this output to raw-frame pixels of the calibrated mode."""
        return np.asarray((pixels - np.array([self.shift_x_px, self.shift_y_px])) / self.scale)
