"""The band at the seam, pixel by pixel: where a view's picture is mixed with the other one, or is the other one already."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.common_field import raw_pixels
from prismstereo_calibration.seam import Seam
from prismstereo_hw.errors import UsageError
from prismstereo_hw.view import View

__all__ = ["seam_band"]

Mask = NDArray[np.bool_]
_LEAST_HALF_PX = 1.0  # a step goes through a pixel somewhere, and is found to a third of one


def seam_band(seam: Seam, views: tuple[View, View], frame_width: int, frame_height: int) -> tuple[Mask, Mask]:
    """Tell which pixels (height, width) of both views' upright pictures lie in the blended band, or beyond it.

    `UsageError` for views that do not lie on two sides of the seam.
    """
    pixels = [raw_pixels(view, frame_width, frame_height) for view in views]
    lean = 0.0 if math.isnan(seam.slant_deg) else math.tan(math.radians(seam.slant_deg))
    beyond = [p[..., 0] - seam.column_px - (p[..., 1] - (frame_height - 1) / 2) * lean for p in pixels]
    sides = [np.sign(float(np.median(off))) for off in beyond]
    if sides[0] * sides[1] >= 0 or views[0].exposures > 1:
        raise UsageError(
            f"the seam at column {seam.column_px:.0f} does not lie between the two views: give a seam for views side by side "
            "only, found with their own layout"
        )
    half = max(seam.width_px / 2, _LEAST_HALF_PX)
    left, right = (np.asarray(off * side <= half) for off, side in zip(beyond, sides, strict=True))
    return left, right
