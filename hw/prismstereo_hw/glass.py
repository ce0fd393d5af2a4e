"""Glasses by name: refractive index from the makers' dispersion formulas.

Sellmeier: n^2 - 1 = sum_i B_i w^2 / (w^2 - C_i), w the wavelength in micrometres. Plastics, whose data scatter from
batch to batch, are given by their index alone.
"""

from __future__ import annotations

import math

from prismstereo_hw.errors import RigError

__all__ = ["GLASSES", "HELIUM_D_NM", "refractive_index"]

HELIUM_D_NM = 587.5618

_SELLMEIER: dict[str, tuple[tuple[float, float], ...]] = {  # (B, C in square micrometres): the makers' data sheets
    "N-BK7": ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)),
    "fused silica": ((0.6961663, 0.00467914826), (0.4079426, 0.0135120631), (0.8974794, 97.9340025)),
    "N-SF11": ((1.73759695, 0.013188707), (0.313747346, 0.0623068142), (1.89878101, 155.23629)),
}
_CONSTANT: dict[str, float] = {"PMMA": 1.4917, "PC": 1.586}

GLASSES = (*_SELLMEIER, *_CONSTANT)


def refractive_index(glass: str, wavelength_nm: float = HELIUM_D_NM) -> float:
    """Return the index of a glass by name, or of a number given as text ("1.62"); `RigError` lists the names.

    >>> round(refractive_index("N-BK7"), 4)
    1.5168
    """
    if glass in _SELLMEIER:
        w2 = (wavelength_nm / 1000) ** 2
        return math.sqrt(1 + sum(b * w2 / (w2 - c) for b, c in _SELLMEIER[glass]))
    if glass in _CONSTANT:
        return _CONSTANT[glass]
    try:
        index = float(glass)
    except ValueError:
        raise RigError(f"there is no glass {glass!r}: choose one of {', '.join(GLASSES)}, or give its index") from None
    if not 1.0 < index < 3.0:
        raise RigError(
            f"glass index {glass} is not between 1 and 3: give one like 1.52, or choose {', '.join(GLASSES)}"
        )
    return index
