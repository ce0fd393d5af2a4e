"""One exposure of the sensor: both views, one shutter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import ImageError

__all__ = ["RawFrame"]


@dataclass(frozen=True, slots=True)
class RawFrame:
    """A raw picture, (height, width) or (height, width, 3) uint8 in BGR order, with both views in it.

    `timestamp_us` is the sensor's monotonic clock at mid-exposure. `lens_position` is the focus motor's setting where
    the camera tells it: a calibration belongs to one of them.
    """

    pixels: NDArray[np.uint8]
    index: int = 0
    timestamp_us: int = 0
    lens_position: int | None = None

    def __post_init__(self) -> None:
        """Refuse anything that is not an 8-bit picture."""
        shape, dtype = self.pixels.shape, self.pixels.dtype
        if dtype != np.uint8 or len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] != 3) or 0 in shape:
            raise ImageError(f"frame {self.index} is {dtype} {shape}: a raw frame is 8-bit grey or BGR, not empty")

    @property
    def width(self) -> int:
        """Columns of the whole frame."""
        return int(self.pixels.shape[1])

    @property
    def height(self) -> int:
        """Rows of the whole frame."""
        return int(self.pixels.shape[0])
