"""The sensor: photons counted, wells that fill up, and motion during the exposure."""

from __future__ import annotations

import math

import numpy as np
import pytest

from prismstereo_hw.errors import UsageError
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Rectangle, Scene
from prismstereo_hw.sensor import SensorModel
from prismstereo_hw.texture import Plain
from prismstereo_hw.twin import Twin

X, Y, _ = np.eye(3)
ROUNDING = 1 / 12


def read_out(sensor: SensorModel, grey: float, seed: int = 1) -> np.ndarray:
    flat = np.full((400, 400), grey, np.float32)
    return sensor.expose(flat, np.random.default_rng(seed)).astype(float)


@pytest.mark.parametrize("grey", [10.0, 40.0, 90.0, 160.0])
def test_photon_noise_has_the_variance_of_the_count(grey: float) -> None:
    sensor = SensorModel(electrons_per_grey=20.0, full_well_electrons=1e6, read_noise_electrons=8.0)
    seen = read_out(sensor, grey)
    assert seen.mean() == pytest.approx(grey, abs=0.05)
    assert seen.var() == pytest.approx((grey * 20.0 + 64.0) / 400.0 + ROUNDING, rel=0.03)


def test_twice_the_exposure_at_half_the_gain_is_as_bright_and_half_as_noisy_in_variance() -> None:
    short = SensorModel(exposure_us=5_000.0, gain=2.0, read_noise_electrons=0.0)
    long = SensorModel(exposure_us=10_000.0, gain=1.0, read_noise_electrons=0.0)
    one, other = read_out(short, 100.0), read_out(long, 100.0)
    assert one.mean() == pytest.approx(other.mean(), abs=0.05)
    assert (one.var() - ROUNDING) / (other.var() - ROUNDING) == pytest.approx(2.0, rel=0.03)


def test_light_counts_like_exposure() -> None:
    np.testing.assert_array_equal(
        read_out(SensorModel(light=0.5), 120.0), read_out(SensorModel(exposure_us=5_000.0), 120.0)
    )


def test_a_full_well_takes_no_more_and_shows_no_photon_noise() -> None:
    sensor = SensorModel(full_well_electrons=6_000.0, electrons_per_grey=40.0, read_noise_electrons=0.0)
    assert set(np.unique(read_out(sensor, 240.0))) == {150.0}
    assert set(np.unique(read_out(SensorModel(light=4.0), 200.0))) <= {254.0, 255.0}


def test_the_dark_reads_the_black_level_and_the_read_noise() -> None:
    seen = read_out(SensorModel(black_level_grey=16.0, read_noise_electrons=80.0), 0.0)
    assert seen.mean() == pytest.approx(16.0, abs=0.03)
    assert seen.var() == pytest.approx(4.0 + ROUNDING, rel=0.03)


def test_the_seed_makes_the_noise() -> None:
    sensor = SensorModel()
    np.testing.assert_array_equal(read_out(sensor, 80.0, seed=4), read_out(sensor, 80.0, seed=4))
    assert not np.array_equal(read_out(sensor, 80.0, seed=4), read_out(sensor, 80.0, seed=5))


def test_motion_during_the_exposure_smears_an_edge_by_the_way_it_goes(oak: Rig) -> None:
    speed_mm_s, exposure_us, z_mm = 400.0, 40_000.0, 600.0
    edge = Rectangle(
        "door", np.array([1e4, 0.0, z_mm]), X, Y, 1e4, 1e4, Plain(200.0), velocity_mm_s=(speed_mm_s, 0.0, 0.0)
    )
    sensor = SensorModel(
        exposure_us=exposure_us, reference_exposure_us=exposure_us, shot_noise=False, read_noise_electrons=0.0,
        motion_samples=48,
    )  # fmt: skip
    scene = Scene("door", (edge,), background_grey=40.0)
    video = Mode(width=1280, height=48, rate_hz=30.0)
    twin = Twin(oak, scene, mode=video, sensor=sensor)
    row = twin.frame(timestamp_us=0).pixels[video.height // 2, video.width // 2 :].astype(float)
    spread = np.diff(row)[50:400] / 160
    at = np.arange(len(spread))
    middle = spread @ at / spread.sum()
    sigma_px = math.sqrt(spread @ (at - middle) ** 2 / spread.sum())

    view = fold(oak, "left")
    tops = np.array([[s * speed_mm_s * exposure_us / 2e6, 0.0, z_mm] for s in (-1, 1)])
    smear_px = abs(np.diff(oak.lens(video).project_slopes(view.slopes(tops))[:, 0])[0])
    assert smear_px > 15
    assert spread.sum() == pytest.approx(1.0, abs=0.02)
    assert sigma_px == pytest.approx(smear_px / math.sqrt(12), rel=0.02)
    frozen = (
        Twin(oak, scene, mode=video, noise=0.0)
        .frame(timestamp_us=0)
        .pixels[video.height // 2, video.width // 2 :]
        .astype(float)
    )
    assert middle == pytest.approx(float(np.argmax(np.diff(frozen)[50:400])), abs=1.0)  # the stamp is mid-exposure


@pytest.mark.parametrize(
    ("label", "value"),
    [
        ("exposure_us", 0.0), ("gain", -1.0), ("light", math.nan), ("read_noise_electrons", -1.0), ("motion_samples", 0),
        ("black_level_grey", 300.0), ("full_well_electrons", math.inf), ("rolling_shutter_us", -1.0),
    ],
)  # fmt: skip
def test_a_sensor_that_there_is_not_is_refused_by_name(label: str, value: float) -> None:
    with pytest.raises(UsageError, match=f"{label} is .*: give"):
        SensorModel(**{label: value})
