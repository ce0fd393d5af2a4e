"""The exposure follows what both views see, and nothing else: no lamp beside it, no band, no dark rim."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_calibration.common_field import SIDES, common_field
from prismstereo_calibration.metering import (
    FLICKER_50_HZ_US,
    FLICKER_60_HZ_US,
    Exposure,
    ExposureLimits,
    Metering,
    metered,
    metering_weights,
    next_exposure,
)
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.static_mask import StaticMask, StaticReason
from prismstereo_hw.errors import ImageError, UsageError
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.sensor import SensorModel
from prismstereo_hw.twin import Twin

Grey = NDArray[np.float32]
LIMITS = ExposureLimits(exposure_max_us=30_000.0)


@pytest.fixture(scope="module")
def mask(small: Rig) -> StaticMask:
    """A small OAK-1's: geometry, a band of ten columns at the seam, a dark rim of twenty."""
    calibration = Calibration.nominal(small)
    left, right = (
        np.where(common_field(calibration, side), StaticReason.GOOD, StaticReason.OUTSIDE).astype(np.uint8)
        for side in SIDES
    )
    left[:, :10], right[:, -10:] = StaticReason.SEAM, StaticReason.SEAM  # the left view fills the right half
    left[:, -20:], right[:, :20] = StaticReason.VIGNETTED, StaticReason.VIGNETTED
    return StaticMask(left, right)


@pytest.fixture(scope="module")
def weights(small: Rig, mask: StaticMask) -> NDArray[np.uint8]:
    return metering_weights(Calibration.nominal(small), mask)


@pytest.fixture(scope="module")
def scene(small: Rig) -> Grey:
    """What the sensor sees at the reference exposure, in grey levels."""
    return Twin(small, facing_plane(small, 600.0), noise=0.0).frame().pixels.astype(np.float32)


def lamp(scene: Grey, where: NDArray[np.bool_]) -> Grey:
    """The scene with something a hundred times as bright as white."""
    return np.where(where, np.float32(25_000), scene)


def followed(scene: Grey, weights: NDArray[np.uint8], start: Exposure, limits: ExposureLimits) -> list[Exposure]:
    """The exposures of forty frames under automatic exposure, noise and saturation included."""
    rng, exposures = np.random.default_rng(7), [start]
    for _ in range(40):
        now = exposures[-1]
        sensor = SensorModel(exposure_us=now.exposure_us, gain=now.gain)
        exposures.append(next_exposure(metered(sensor.expose(scene, rng), weights), now, limits))
    return exposures


def test_metered_are_the_pixels_that_are_good_for_something(
    small: Rig, mask: StaticMask, weights: NDArray[np.uint8]
) -> None:
    assert weights.shape == (180, 320)
    np.testing.assert_array_equal(small.views[0].cut(weights) > 0, mask.left == StaticReason.GOOD)
    np.testing.assert_array_equal(small.views[1].cut(weights) > 0, mask.right == StaticReason.GOOD)
    by_geometry = metering_weights(Calibration.nominal(small))
    assert by_geometry.sum() > weights.sum()
    assert not np.any((by_geometry == 0) & (weights > 0))


def test_a_lamp_outside_of_the_common_field_changes_no_exposure(scene: Grey, weights: NDArray[np.uint8]) -> None:
    start = Exposure(3000.0, 1.0)
    plain, beside = (followed(picture, weights, start, LIMITS) for picture in (scene, lamp(scene, weights == 0)))
    assert plain == beside

    within = np.zeros(scene.shape, bool)
    within[60:120, 200:280] = True
    assert (weights[within] > 0).all()
    inside = followed(lamp(scene, within), weights, start, LIMITS)
    assert inside[-1].light < 0.8 * plain[-1].light


@pytest.mark.parametrize("light_factor", [1 / 60, 0.2, 1.0, 8.0, 200.0])
def test_the_target_is_reached_from_anywhere_without_overshooting(
    scene: Grey, weights: NDArray[np.uint8], light_factor: float
) -> None:
    exposures = followed(scene * np.float32(light_factor), weights, Exposure(10_000.0, 1.0), LIMITS)
    light = np.log2([each.light for each in exposures])
    settled = exposures[-1]

    sensor = SensorModel(exposure_us=settled.exposure_us, gain=settled.gain)
    found = metered(sensor.expose(scene * np.float32(light_factor), np.random.default_rng(1)), weights)
    assert found.mean_grey == pytest.approx(LIMITS.target_grey, rel=0.07)
    assert np.ptp(light[15:]) < 1e-9  # at rest after fifteen frames, and it stays there
    steps = np.diff(light)
    assert (np.sign(steps[np.abs(steps) > 1e-9]) == np.sign(light[-1] - light[0])).all()  # one direction all the way
    assert np.abs(steps).max() <= 2 + 1e-9


def test_a_long_exposure_comes_before_gain_and_both_have_limits() -> None:
    assert LIMITS.nearest(12_000.0) == Exposure(12_000.0, 1.0)
    assert LIMITS.nearest(60_000.0) == Exposure(30_000.0, 2.0)
    assert LIMITS.nearest(1e9) == Exposure(30_000.0, 16.0)
    assert LIMITS.nearest(1.0) == Exposure(20.0, 1.0)


@pytest.mark.parametrize("period_us", [FLICKER_50_HZ_US, FLICKER_60_HZ_US])
def test_under_mains_light_exposures_are_whole_periods_where_they_can_be(period_us: float) -> None:
    limits = ExposureLimits(exposure_max_us=33_400.0, flicker_us=period_us)
    for light in np.geomspace(300.0, 300_000.0, 60):
        chosen = limits.nearest(float(light))
        assert chosen.light == pytest.approx(light)
        if chosen.exposure_us >= period_us:
            assert chosen.exposure_us / period_us == pytest.approx(round(chosen.exposure_us / period_us))
            assert chosen.gain < 2 or chosen.exposure_us > 25_000
        else:
            assert light < period_us  # too bright: flicker is the lesser evil


def test_saturated_pixels_hold_the_light_back() -> None:
    now = Exposure(10_000.0, 1.0)
    crowded = Metering(mean_grey=80.0, saturated_share=0.3, dark_share=0.5)
    assert next_exposure(crowded, now, LIMITS).light < 0.9 * now.light
    few = Metering(mean_grey=80.0, saturated_share=0.01, dark_share=0.5)
    assert next_exposure(few, now, LIMITS).light > now.light
    close = Metering(mean_grey=103.0, saturated_share=0.0, dark_share=0.0)
    assert next_exposure(close, now, LIMITS) == now


def test_shares_and_mean_are_those_of_the_metered_pixels_and_the_brightest_channel() -> None:
    frame = np.zeros((10, 10, 3), np.uint8)
    frame[:5, :, 1], frame[5:, :, 2] = 100, 255
    weights = np.zeros((10, 10), np.uint8)
    weights[4:7] = 1
    found = metered(frame, weights)
    assert found == Metering(mean_grey=(100 + 2 * 255) / 3, saturated_share=2 / 3, dark_share=0.0)


def test_what_cannot_be_metered_is_refused(weights: NDArray[np.uint8]) -> None:
    with pytest.raises(ImageError, match="10x10, but the metering weights are for 320x180"):
        metered(np.zeros((10, 10), np.uint8), weights)
    with pytest.raises(ImageError, match="no pixel is metered"):
        metered(np.zeros((10, 10), np.uint8), np.zeros((10, 10), np.uint8))
    for wrong in (
        {"exposure_min_us": 5.0, "exposure_max_us": 4.0},
        {"target_grey": 255.0},
        {"gain_min": 0.0},
        {"flicker_us": 0.0},
    ):
        with pytest.raises(UsageError, match="give"):
            ExposureLimits(**wrong)
