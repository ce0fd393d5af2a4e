"""Measuring: distances, planes, balls and heights with their standard deviations, and the figures that tell how good depth is.

Start reading at `relief` for the one, at `flat_target` for the other.
"""

from __future__ import annotations

from prismstereo.measuring.distance import distance
from prismstereo.measuring.height import height_over
from prismstereo.measuring.measured import Measured
from prismstereo.measuring.patch import Patch
from prismstereo.measuring.plane import Plane, fit_plane
from prismstereo.measuring.relief import Relief
from prismstereo.measuring.sphere import Sphere, fit_sphere

__all__ = [
    "Measured",
    "Patch",
    "Plane",
    "Relief",
    "Sphere",
    "distance",
    "fit_plane",
    "fit_sphere",
    "height_over",
]
