"""A disparity map at the resolution of a still, and how each of its pixels came about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.flags import Flag
from prismstereo.fusion.upsampling.grid import Axis

__all__ = ["Upsampled"]


@dataclass(frozen=True, slots=True)
class Upsampled:
    """What an upsampler gives: all arrays are (H, W), the still's size.

    `disparity_px`: float32 pixels of the still, NaN where there is none. `flags`: uint8, see `Flag`. `columns` and `rows` say
    where its sites lie. `sources`: int32 site of each pixel, where the flags alone do not tell it, else None.
    """

    disparity_px: NDArray[np.float32]
    flags: NDArray[np.uint8]
    columns: Axis
    rows: Axis
    sources: NDArray[np.int32] | None = None

    @property
    def source(self) -> NDArray[np.int32]:
        """The site each pixel comes from, row * width + column of the map: int32, -1 for none; made when asked."""
        if self.sources is not None:
            return self.sources
        right, lower, band = ((self.flags & flag) != 0 for flag in (Flag.RIGHT, Flag.LOWER, Flag.BAND))
        row = self.rows.cell[:, None] + np.where(band, lower, self.rows.part[:, None] >= np.float32(0.5))
        column = self.columns.cell + np.where(band, right, self.columns.part >= np.float32(0.5))
        row, column = np.minimum(row, self.rows.sites_given - 1), np.minimum(column, self.columns.sites_given - 1)
        source = (row * self.columns.sites_given + column).astype(np.int32)
        return np.where(np.isnan(self.disparity_px), np.int32(-1), source)
