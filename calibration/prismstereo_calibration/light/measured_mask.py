"""The static mask of a built unit: from its cameras, the seam found in its frames, and its flat field.

Where several reasons hold, the nearest to the glass is given: `seam`, then `vignetted`, then `outside`.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.common_field import SIDES, common_field, raw_pixels
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.light.flat_field import FlatField
from prismstereo_calibration.light.seam_band import seam_band
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.seam import Seam
from prismstereo_calibration.static_mask import StaticMask, StaticReason

__all__ = ["VIGNETTED_BELOW", "measured_mask"]

Mask = NDArray[np.bool_]

VIGNETTED_BELOW = 0.4  # of a view's middle light: noise counts more than twice as much there
_SPECK_PX = 9  # what is smaller is dust or noise, and no rim


def measured_mask(calibration: Calibration, seam: Seam | None = None, flat: FlatField | None = None) -> StaticMask:
    """Give every pixel of both views the reason for which it can never be matched, if there is one.

    Without a seam none is `seam`, without a flat field none is `vignetted`. `CalibrationError` for a flat field of another
    size, `UsageError` for a seam that does not lie between the views.
    """
    width, height = calibration.frame_width, calibration.frame_height
    dark = _dark(calibration, flat)
    none = tuple(np.zeros_like(each) for each in dark)
    bands = none if seam is None else seam_band(seam, calibration.views, width, height)
    codes: list[NDArray[np.uint8]] = []
    for number, (side, view) in enumerate(zip(SIDES, calibration.views, strict=True)):
        seen = common_field(calibration, side, hidden=dark[1 - number] | bands[1 - number])
        own = view.shows(raw_pixels(view, width, height).astype(float), width, height)
        reasons = np.where(seen & own, StaticReason.GOOD, StaticReason.OUTSIDE).astype(np.uint8)
        reasons[dark[number]] = StaticReason.VIGNETTED
        reasons[bands[number]] = StaticReason.SEAM
        codes.append(reasons)
    return StaticMask(codes[0], codes[1])


def _dark(calibration: Calibration, flat: FlatField | None) -> tuple[Mask, Mask]:
    """Tell which pixels of each view get too little light, specks left out."""
    sizes = [view.upright_size(calibration.frame_width, calibration.frame_height) for view in calibration.views]
    if flat is None:
        return np.zeros(sizes[0][::-1], bool), np.zeros(sizes[1][::-1], bool)
    found: list[Mask] = []
    for side, light, (w, h) in zip(SIDES, flat.light, sizes, strict=True):
        if light.shape != (h, w):
            raise CalibrationError(
                f"the flat field's {side} view has {light.shape[1]}x{light.shape[0]} pixels, but the calibration's {w}x{h}: "
                "take it in the mode that was calibrated"
            )
        dark = (light < VIGNETTED_BELOW * float(np.median(light))).astype(np.uint8)
        kernel = np.ones((_SPECK_PX, _SPECK_PX), np.uint8)
        rims = cv2.morphologyEx(dark, cv2.MORPH_OPEN, kernel, borderType=cv2.BORDER_REPLICATE)
        rims = cv2.morphologyEx(rims, cv2.MORPH_CLOSE, kernel, borderType=cv2.BORDER_REPLICATE)
        found.append(rims.astype(bool))
    return found[0], found[1]
