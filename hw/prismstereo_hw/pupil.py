"""The pupil of the real lens, sampled: the ghosted band at the seam, vignetting and defocus.

A pixel collects rays from the whole pupil. They meet in the plane the lens is focused at, so a ray from the point p of the
pupil (the plane z = 0 of the rig frame) to a pixel of slopes s has slopes s - p / focus_mm; focus_mm is the distance from a
view's virtual pinhole along its axis, because the glass that moves the pinhole moves the focus by as much. Near the edge
that divides the views, one part of the pupil looks through one mirror and the rest through the other: the pixel is a mix of
both. A ray that gets lost brings no light, which is what vignetting is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError
from prismstereo_hw.optics.surfaces import Surface
from prismstereo_hw.optics.trace import Traced, trace
from prismstereo_hw.rig import Mode, Rig

__all__ = ["Pupil", "blended_px", "rays_from"]

Array = NDArray[np.float64]
_GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
_MOST_SAMPLES = 1024
_BISECTIONS = 50


@dataclass(frozen=True, slots=True)
class Pupil:
    """How the pupil is sampled; `UsageError` for what cannot be.

    `samples` points stand for equal areas. With `defocus` they cover the disc and every pixel is made of all of them;
    otherwise they lie side by side along x and make only the blended band at the seam. One sample is the middle of the
    pupil, for every pixel. `focus_mm` of None is the middle of the rig's range in sharpness: of its inverse distances.
    """

    samples: int = 1
    defocus: bool = False
    focus_mm: float | None = None

    def __post_init__(self) -> None:
        """Refuse no samples, too many, and a focus behind the lens."""
        if not 1 <= self.samples <= _MOST_SAMPLES:
            raise UsageError(f"{self.samples} pupil samples: give 1 to {_MOST_SAMPLES}, some 8 to 16 show the seam")
        if self.focus_mm is not None and not self.focus_mm > 0:
            raise UsageError(f"focus_mm is {self.focus_mm:g}: give a positive distance, inf for a lens set to infinity")

    def points_mm(self, diameter_mm: float) -> Array:
        """Return the sampled points of a round pupil, (samples, 2) mm."""
        if self.samples == 1:
            return np.zeros((1, 2))
        share = (np.arange(self.samples) + 0.5) / self.samples
        if self.defocus:  # a sunflower: equal areas, no direction preferred
            radius, angle = np.sqrt(share) / 2, _GOLDEN_ANGLE * np.arange(self.samples)
            return diameter_mm * np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
        cut = np.array([_cut_off(float(part)) for part in share])
        return np.stack([diameter_mm / 2 * cut, np.zeros(self.samples)], axis=-1)

    def focused_mm(self, rig: Rig) -> float:
        """Return the distance in focus: as told, or where both ends of the rig's range are equally blurred."""
        if self.focus_mm is not None:
            return self.focus_mm
        return 2 / (1 / rig.range.near_mm + 1 / rig.range.far_mm)

    def blended(self, rig: Rig, mode: Mode) -> NDArray[np.bool_]:
        """Tell which columns (width,) of the raw frame are made of rays from the whole pupil."""
        if self.samples == 1:
            return np.zeros(mode.width, bool)
        if self.defocus:
            return np.ones(mode.width, bool)
        return np.asarray(np.abs(np.arange(mode.width) - rig.lens(mode).cx_px) < blended_px(rig, mode) / 2)


def blended_px(rig: Rig, mode: Mode | None = None) -> float:
    """Return how many columns of a mode (default: video) look through both mirrors: f D over the way to the edge."""
    if rig.split_edge_mm is None:
        return 0.0
    return rig.lens(mode).fx_px * rig.camera.pupil_diameter_mm / rig.split_edge_mm


def rays_from(point_mm: Array, focus_mm: float, slopes: Array, surfaces: tuple[Surface, ...]) -> Traced:
    """Send the rays of pixels with ideal slopes (N, 2) from a point (2,) of the pupil through the surfaces of a view."""
    aimed = slopes - point_mm / focus_mm
    direction = np.concatenate([aimed, np.ones_like(aimed[:, :1])], axis=1)
    direction /= np.sqrt(np.einsum("ij,ij->i", direction, direction))[:, None]
    return trace(surfaces, np.array([*point_mm, 0.0]), direction)


def _cut_off(share: float) -> float:
    """Return the chord x = c of the unit circle that has this share of the disc on its left: bisection."""
    low, high = -1.0, 1.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        left = 1 - (math.acos(middle) - middle * math.sqrt(1 - middle * middle)) / math.pi
        low, high = (middle, high) if left < share else (low, middle)
    return (low + high) / 2
