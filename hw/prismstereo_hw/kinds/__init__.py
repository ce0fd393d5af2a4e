"""The kinds of rigs there are; a rig file names its own as `kind`."""

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
