"""What dispersion does: how far red and blue of one point lie apart in the picture."""

from __future__ import annotations

import msgspec
import numpy as np

from prismstereo_hw.glass import refractive_index
from prismstereo_hw.kinds import BiprismRig, PlateRig, PrismRig
from prismstereo_hw.optics.sight import lit_slopes, sight
from prismstereo_hw.rig import Rig

__all__ = ["BLUE_F_NM", "RED_C_NM", "chromatic_shift_px", "in_colour"]

RED_C_NM, BLUE_F_NM = 656.2725, 486.1327  # hydrogen C and F, the ends of the visible range in glass catalogues


def in_colour(rig: Rig, wavelength_nm: float) -> Rig:
    """Return the rig as light of one wavelength meets it: the same, its glass given by its index; mirrors know no colour."""
    if isinstance(rig, PrismRig):
        index = repr(refractive_index(rig.prism.glass, wavelength_nm))
        return msgspec.structs.replace(rig, prism=msgspec.structs.replace(rig.prism, glass=index))
    if isinstance(rig, PlateRig | BiprismRig):
        return msgspec.structs.replace(rig, glass=repr(refractive_index(rig.glass, wavelength_nm)))
    return rig


def chromatic_shift_px(rig: Rig, distance_mm: float) -> float:
    """Return the largest distance, along the middle row of the left view, of the red and the blue image of one point.

    Points lie `distance_mm` from the viewpoint; red is hydrogen C, blue hydrogen F. Plastics have no dispersion here.
    """
    view, slopes = sight(rig, "left"), lit_slopes(rig, "left", middle_row=True)
    _, direction = view.rays(slopes)
    points = view.centre_mm + distance_mm * direction
    red, blue = (sight(in_colour(rig, nm), "left").slopes(points) for nm in (RED_C_NM, BLUE_F_NM))
    return float(rig.lens().fx_px * np.nanmax(np.linalg.norm(red - blue, axis=-1), initial=0.0))
