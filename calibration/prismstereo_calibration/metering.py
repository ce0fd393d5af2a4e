"""Metering: how long to expose so that what BOTH views see is neither black nor white.

Only pixels of the common field count. A lamp that one view alone sees, the blended band at the seam and the dark rim of the
glass say nothing about the pixels that will be matched, and must not change the exposure. All of it is plain arithmetic, in
stops (powers of two): light is exposure times gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.common_field import SIDES, common_field, raw_pixels
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.static_mask import StaticMask, StaticReason
from prismstereo_hw.errors import ImageError, UsageError

__all__ = ["Exposure", "ExposureLimits", "Metering", "metered", "metering_weights", "next_exposure"]

FLICKER_50_HZ_US = 10_000.0
FLICKER_60_HZ_US = 25_000.0 / 3
_SATURATED_GREY, _DARK_GREY = 250, 8
_MUCH_SATURATED = 0.02  # of the metered pixels: above, the mean says too little about the light
_CROWDED_STOPS = 1.0  # how much darker to expose when all metered pixels are saturated
_DAMPING = 0.6  # of the missing stops are made up at once
_LARGEST_STEP = 2.0
_CLOSE_ENOUGH = 0.08  # stops: nearer to the target nothing is changed, so that the picture rests


@dataclass(frozen=True, slots=True)
class Metering:
    """What the metered pixels of a frame say: mean grey level, and the shares 0..1 that are saturated and dark."""

    mean_grey: float
    saturated_share: float
    dark_share: float


@dataclass(frozen=True, slots=True)
class Exposure:
    """Exposure in microseconds and gain as a factor."""

    exposure_us: float
    gain: float

    @property
    def light(self) -> float:
        """Exposure times gain: what the grey levels go with."""
        return self.exposure_us * self.gain


@dataclass(frozen=True, slots=True)
class ExposureLimits:
    """What the sensor can do, and what is wanted of it; `UsageError` for limits that leave nothing.

    `flicker_us` is the period of mains light, `FLICKER_50_HZ_US` or `FLICKER_60_HZ_US`: exposures as long as that or longer
    are whole multiples of it. None: any exposure will do.
    """

    exposure_min_us: float = 20.0
    exposure_max_us: float = 33_000.0
    gain_min: float = 1.0
    gain_max: float = 16.0
    target_grey: float = 100.0
    black_grey: float = 0.0
    flicker_us: float | None = None

    def __post_init__(self) -> None:
        """Refuse empty ranges."""
        if not (0 < self.exposure_min_us <= self.exposure_max_us and 0 < self.gain_min <= self.gain_max):
            raise UsageError(
                f"exposure {self.exposure_min_us:g} to {self.exposure_max_us:g} us, gain {self.gain_min:g} to "
                f"{self.gain_max:g}: give positive ranges, the smaller number first"
            )
        if not 0 <= self.black_grey < self.target_grey < _SATURATED_GREY:
            raise UsageError(
                f"target of {self.target_grey:g} grey levels over a black of {self.black_grey:g}: give one between black and "
                f"{_SATURATED_GREY}"
            )
        if self.flicker_us is not None and not self.flicker_us > 0:
            raise UsageError(
                f"flicker_us is {self.flicker_us:g}: give the period of the light in microseconds, or None"
            )

    def nearest(self, light: float) -> Exposure:
        """Return the exposure and gain for an amount of light, or as near as they come: a long exposure before a high gain."""
        exposure_us = min(max(light / self.gain_min, self.exposure_min_us), self.exposure_max_us)
        period_us = self.flicker_us
        if period_us is not None and exposure_us >= period_us:
            # a whole number of periods, the rest by gain; the tiny part more forgives rounding
            whole_us = math.floor(exposure_us / period_us + 1e-9) * period_us
            exposure_us = min(max(whole_us, self.exposure_min_us), self.exposure_max_us)
        return Exposure(exposure_us, min(max(light / exposure_us, self.gain_min), self.gain_max))


def metering_weights(calibration: Calibration, mask: StaticMask | None = None) -> NDArray[np.uint8]:
    """Return 1 for every pixel of the raw frame (height, width) that is metered, 0 for all others.

    Metered is what both views see within the range window: by the calibration's static mask, which knows seam and dark rims
    as well, or, without one, by geometry alone. Exposures that are taken one after the other lie one below the other.
    """
    width, height = calibration.frame_width, calibration.frame_height
    weights = np.zeros((height * calibration.left_view.exposures, width), np.uint8)
    for side, view in zip(SIDES, calibration.views, strict=True):
        good = common_field(calibration, side) if mask is None else mask.of(side) == StaticReason.GOOD
        raw = raw_pixels(view, width, height)
        own = raw[good & view.shows(raw.astype(float), width, height)]
        weights[own[:, 1] + view.exposure * height, own[:, 0]] = 1
    return weights


def metered(frame: NDArray[np.uint8], weights: NDArray[np.uint8]) -> Metering:
    """Meter a raw frame (height, width[, 3]) uint8; of a coloured pixel its brightest channel counts.

    `ImageError` where the weights belong to another size, or nothing is metered.
    """
    if frame.shape[:2] != weights.shape:
        raise ImageError(
            f"the frame is {frame.shape[1]}x{frame.shape[0]}, but the metering weights are for {weights.shape[1]}x"
            f"{weights.shape[0]}: make them from the calibration of this mode"
        )
    grey = frame.max(axis=2) if frame.ndim == 3 else frame
    counts = np.bincount(grey[weights > 0], minlength=256)
    total = int(counts.sum())
    if not total:
        raise ImageError("no pixel is metered: both views have no common field within the range, calibrate again")
    return Metering(
        mean_grey=float(counts @ np.arange(256) / total),
        saturated_share=float(counts[_SATURATED_GREY:].sum() / total),
        dark_share=float(counts[: _DARK_GREY + 1].sum() / total),
    )


def next_exposure(metering: Metering, now: Exposure, limits: ExposureLimits) -> Exposure:
    """Return the exposure of a coming frame: a damped step towards the target, none where it is met within a twelfth of a stop.

    A frame full of saturated pixels is brighter than its mean says, so it is darkened further.
    """
    level = max(metering.mean_grey - limits.black_grey, 0.5)
    stops = math.log2((limits.target_grey - limits.black_grey) / level)
    if metering.saturated_share > _MUCH_SATURATED:
        stops = min(stops, 0.0) - _CROWDED_STOPS * metering.saturated_share
    if abs(stops) < _CLOSE_ENOUGH:
        return limits.nearest(now.light)
    step = min(max(_DAMPING * stops, -_LARGEST_STEP), _LARGEST_STEP)
    return limits.nearest(now.light * 2**step)
