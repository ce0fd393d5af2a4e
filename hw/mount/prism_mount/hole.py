"""A round hole that matters to a builder: where it is, which way it goes, how wide."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from build123d import Part
from numpy.typing import NDArray

from prism_mount.solids import rod

__all__ = ["Hole", "drilled"]


@dataclass(frozen=True, slots=True)
class Hole:
    """From `start` to `end` (3,) mm in the rig frame; `purpose` says what goes in."""

    part: str
    purpose: str
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    diameter_mm: float


def drilled(part: Part, holes: Iterable[Hole], over_mm: float = 0.0) -> Part:
    """Drill holes into a part; `over_mm` lengthens the drill at both ends so that it breaks through cleanly."""
    for hole in holes:
        axis = (hole.end - hole.start) / np.linalg.norm(hole.end - hole.start)
        part = part - rod(hole.start - over_mm * axis, hole.end + over_mm * axis, hole.diameter_mm)
    return part
