"""What the world does to a rig: warmth, a focus motor that breathes, dust and drops on the glass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.coverage import SIDES
from prismstereo_hw.errors import UsageError
from prismstereo_hw.kinds import AnyRig, PrismRig
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

__all__ = ["EXPANSION_PER_K", "Spot", "Surroundings", "seeded_spots"]

Array = NDArray[np.float64]

EXPANSION_PER_K = {  # linear, near 20 degrees C
    "aluminium": 23.6e-6,  # alloy 6061: ASM Metals Handbook, volume 2, 20 to 100 degrees C
    "petg": 70e-6,  # polyethylene terephthalate in designerdata.nl's table; printed parts scatter around it
}


@dataclass(frozen=True, slots=True)
class Spot:
    """Dust or a drop on a glass or mirror: a soft-edged disc, fixed in the raw pixels of one view.

    `x_px`, `y_px` and `radius_px` are in raw video pixels. `dark` is the share of light lost in the middle. `bend` is the
    share by which the middle is magnified (above 0) or shrunk (below 0): a drop is a small lens.
    """

    side: Side
    x_px: float
    y_px: float
    radius_px: float
    dark: float = 0.0
    bend: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a spot that is none, or that would fold the picture over."""
        if not (self.radius_px > 0 and 0 <= self.dark <= 1 and -0.5 <= self.bend <= 0.5):
            raise UsageError(
                f"spot of radius {self.radius_px:g} px, dark {self.dark:g}, bend {self.bend:g}: give a positive radius, "
                "dark between 0 and 1, bend between -0.5 and 0.5"
            )

    def _weight(self, pixels: Array) -> Array:
        share = np.sum((pixels - [self.x_px, self.y_px]) ** 2, axis=-1) / self.radius_px**2
        return np.asarray(np.maximum(0, 1 - share) ** 2)

    def transmission(self, pixels: Array) -> Array:
        """Return the share of light (...) that arrives at video pixels (..., 2)."""
        return 1 - self.dark * self._weight(pixels)

    def looks_at(self, pixels: Array) -> Array:
        """Return the video pixels (..., 2) that would see, through clean glass, what these see."""
        towards = np.array([self.x_px, self.y_px]) - pixels
        return np.asarray(pixels + self.bend * self._weight(pixels)[..., None] * towards)


def seeded_spots(rig: Rig, seed: int, *, dust: int = 0, drops: int = 0) -> tuple[Spot, ...]:
    """Return dust (dark) and drops (clear, bending) at seeded places of both views."""
    rng = np.random.default_rng([seed, dust, drops])
    video = rig.camera.video
    spots = []
    for number in range(dust + drops):
        side = SIDES[int(rng.integers(2))]
        x, y, w, h = rig.views[SIDES.index(side)].rectangle(video.width, video.height)
        at = (float(x + w * rng.uniform(0.05, 0.95)), float(y + h * rng.uniform(0.05, 0.95)))
        radius, strength = float(video.width * rng.uniform(0.008, 0.03)), float(rng.uniform(0.1, 0.45))
        spots.append(
            Spot(side, *at, radius, dark=strength) if number < dust else Spot(side, *at, radius, bend=strength)
        )
    return tuple(spots)


@dataclass(frozen=True, slots=True)
class Surroundings:
    """How the rig stands on this day; the default changes nothing.

    The mount's lengths are those of the rig file at `reference_c`. `breathing_per_step` is the relative change of the
    focal length per step of the focus motor away from `nominal_lens_position`; a `lens_position` of None is a lens that
    does not tell, and stands as calibrated.
    """

    temperature_c: float = 20.0
    reference_c: float = 20.0
    expansion_per_k: float = EXPANSION_PER_K["petg"]
    lens_position: int | None = None
    nominal_lens_position: int = 0
    breathing_per_step: float = 0.0
    spots: tuple[Spot, ...] = ()

    def applied(self, rig: AnyRig) -> AnyRig:
        """Return the rig as it really stands; `UsageError` for a change of temperature of a rig that has no mount."""
        return self._breathed(self._warmed(rig))

    def _warmed(self, rig: AnyRig) -> AnyRig:
        growth = 1 + self.expansion_per_k * (self.temperature_c - self.reference_c)
        if growth == 1:
            return rig
        if not isinstance(rig, PrismRig):
            raise UsageError(
                f"rig {rig.name!r} is no prism rig, so it has no mount whose growth at {self.temperature_c:g} degrees C is "
                f"known: leave temperature_c at {self.reference_c:g}"
            )
        prism = msgspec.structs.replace(rig.prism, pupil_to_prism_mm=growth * rig.prism.pupil_to_prism_mm)
        mirrors = msgspec.structs.replace(
            rig.mirrors, near_edge_mm=growth * rig.mirrors.near_edge_mm, offset_mm=growth * rig.mirrors.offset_mm
        )
        return msgspec.structs.replace(rig, prism=prism, mirrors=mirrors)

    def _breathed(self, rig: AnyRig) -> AnyRig:
        steps = 0 if self.lens_position is None else self.lens_position - self.nominal_lens_position
        longer = 1 + self.breathing_per_step * steps
        if longer == 1:
            return rig
        if not longer > 0:
            raise UsageError(f"breathing by {self.breathing_per_step:g} over {steps} steps leaves no focal length")
        half = math.atan(math.tan(math.radians(rig.camera.hfov_deg / 2)) / longer)
        camera = msgspec.structs.replace(rig.camera, hfov_deg=2 * math.degrees(half))
        return msgspec.structs.replace(rig, camera=camera)
