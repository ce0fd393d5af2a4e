"""The sensor behind the lens: exposure, photons, wells, read-out, and the eight bits that are left.

A scene's grey level is what a pixel reads at the reference exposure, gain 1 and light 1. It stands for
`electrons_per_grey` electrons per level; everything else follows by counting electrons.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError

__all__ = ["SensorModel"]


@dataclass(frozen=True, slots=True)
class SensorModel:
    """What the sensor does with light; `UsageError` for a setting that no sensor has.

    `motion_samples` instants of the exposure are averaged: 1 freezes motion. Row r of the frame is exposed
    `rolling_shutter_us` times r later than row 0; 0 is a global shutter.
    """

    exposure_us: float = 10_000.0
    gain: float = 1.0
    light: float = 1.0  # of the scene, as a factor
    reference_exposure_us: float = 10_000.0
    electrons_per_grey: float = 40.0
    full_well_electrons: float = 10_200.0
    read_noise_electrons: float = 3.0
    shot_noise: bool = True
    black_level_grey: float = 0.0
    motion_samples: int = 1
    rolling_shutter_us: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a setting that no sensor has, naming the value, the rule and the mend."""
        for label in ("exposure_us", "gain", "reference_exposure_us", "electrons_per_grey", "full_well_electrons"):
            _require(0 < getattr(self, label) < np.inf, label, getattr(self, label), "a positive number")
        for label in ("light", "read_noise_electrons", "rolling_shutter_us"):
            _require(0 <= getattr(self, label) < np.inf, label, getattr(self, label), "zero or more")
        _require(0 <= self.black_level_grey <= 255, "black_level_grey", self.black_level_grey, "0 to 255")
        _require(1 <= self.motion_samples <= 256, "motion_samples", self.motion_samples, "1 to 256")

    def electrons(self, grey: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mean number of electrons (...) that grey levels (...) of a scene set free, wells unlimited."""
        per_grey = self.electrons_per_grey * self.light * self.exposure_us / self.reference_exposure_us
        return np.asarray(grey * np.float32(per_grey), np.float32)

    def expose(self, grey: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
        """Read grey levels (height, width) of a scene out as 8 bits.

        Photon noise is taken as normal with the variance of the count: above some ten electrons nothing tells it apart.
        """
        count = self.electrons(grey)
        if self.shot_noise:
            count += np.sqrt(count) * rng.standard_normal(count.shape, np.float32)
        np.minimum(count, np.float32(self.full_well_electrons), out=count)  # photon noise is lost in a full well
        if self.read_noise_electrons:
            count += np.float32(self.read_noise_electrons) * rng.standard_normal(count.shape, np.float32)
        count *= np.float32(self.gain / self.electrons_per_grey)
        count += np.float32(self.black_level_grey)
        return np.clip(np.rint(count, out=count), 0, 255, out=count).astype(np.uint8)

    def instants_us(self, timestamp_us: float) -> list[float]:
        """Return the instants, around mid-exposure, whose pictures are averaged."""
        parts = (np.arange(self.motion_samples) + 0.5) / self.motion_samples - 0.5
        return [float(timestamp_us + part * self.exposure_us) for part in parts]


def _require(holds: bool, label: str, value: float, rule: str) -> None:
    if not holds:
        raise UsageError(f"sensor {label} is {value:g}: give {rule}")
