"""The kinds of rigs there are; a rig file names its own as `kind`.

A kind says which surfaces each viewpoint's rays meet, where its view lies in the frame, and what cannot be built. Xiao and
Lim's three-view prism is not among them. Its views would be ordinary polygons, and the tracer would follow them; what
stands in the way is that a calibration, a rectified pair and a disparity map are of two views: a third one adds a second
baseline and a consistency check between three maps, not a rectangle. Any two of its views are a rig as they are.
"""

from __future__ import annotations

from prismstereo_hw.kinds.biprism import BiprismRig
from prismstereo_hw.kinds.field_sequential import FieldSequentialRig
from prismstereo_hw.kinds.mirror_pairs import FourMirrorRig, WedgeRig
from prismstereo_hw.kinds.plate import PlateRig
from prismstereo_hw.kinds.prism_tir import PrismRig
from prismstereo_hw.kinds.single_mirror import SingleMirrorRig
from prismstereo_hw.kinds.three_mirrors import ThreeMirrorRig
from prismstereo_hw.kinds.two_mirrors import TwoMirrorRig

__all__ = [
    "AnyRig",
    "BiprismRig",
    "FieldSequentialRig",
    "FourMirrorRig",
    "PlateRig",
    "PrismRig",
    "SingleMirrorRig",
    "ThreeMirrorRig",
    "TwoMirrorRig",
    "WedgeRig",
]

AnyRig = (
    PrismRig
    | TwoMirrorRig
    | ThreeMirrorRig
    | SingleMirrorRig
    | PlateRig
    | BiprismRig
    | WedgeRig
    | FourMirrorRig
    | FieldSequentialRig
)
