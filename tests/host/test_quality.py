"""The figures of depth quality are what their definitions say, on maps with known errors; the report tells them."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest

from host.measured_maps import geometry, plane_mm, relief, unit
from prismstereo.measuring import Patch
from prismstereo.measuring.account import Account, FlatTarget, TrueScene, read
from prismstereo.measuring.comparison import compare
from prismstereo.measuring.definitions import DEFINITIONS
from prismstereo.measuring.flat_target import flat_figures
from prismstereo.measuring.gap import Gap
from prismstereo.measuring.levels import levels
from prismstereo.measuring.page import html
from prismstereo.measuring.truth_bins import truth_bins
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig

FACING = np.array([0.0, 0.0, 1.0])
TILTED = np.array([0.2, 0.1, 1.0]) / np.linalg.norm([0.2, 0.1, 1.0])
SEEN = replace(geometry(), width=240, height=200)
SCALE_PX = SEEN.window.scale_px
TRIMMED = 0.9616  # rms of normal noise without half a per cent at either end


def flat(normal=FACING, distance_mm=500.0, noise_px=0.1, seed=1):
    return relief(SEEN, plane_mm(SEEN, normal, distance_mm), noise_px, seed)


@cache
def account(noise_px: float = 0.1, holes: float = 0.0) -> Account:
    shown = flat(noise_px=noise_px)
    shown.inverse_px[np.random.default_rng(2).random(shown.inverse_px.shape) < holes] = np.nan
    figures = flat_figures([shown], 500.0)
    true = np.geomspace(400.0, 3000.0, 20_000)
    found = SCALE_PX / (SCALE_PX / true + np.random.default_rng(3).normal(0, noise_px, true.shape))
    bins = truth_bins(found, true, SCALE_PX)
    counted = levels([np.arange(40, 50, 0.01, np.float32)])
    return Account(
        (FlatTarget("near", figures, 0.25, Gap("corners of the board", 60, 500.0, 0.04, 0.001, 0.2), counted),),
        (TrueScene("desk", 1, 98.0, bins, None, counted),),
    )


def test_white_disparity_noise_is_the_subpixel_rms_and_is_worth_so_much_depth() -> None:
    one = flat_figures([flat(noise_px=0.1)])
    assert one.subpixel_rms_px == pytest.approx(0.1 * TRIMMED, rel=0.03)
    assert one.plane_rms_mm == pytest.approx(500.0**2 / SCALE_PX * 0.1 * TRIMMED, rel=0.03)
    assert one.plane_rms_percent == pytest.approx(100 * one.plane_rms_mm / 500.0, rel=1e-3)
    noise_mm = one.plane_rms_mm / TRIMMED  # and table 1 is half-normal in it
    assert one.plane_fit_mm.mean == pytest.approx(np.sqrt(2 / np.pi) * noise_mm, rel=0.06)
    assert one.plane_fit_mm.variance == pytest.approx((1 - 2 / np.pi) * noise_mm**2, rel=0.2)


def test_accuracy_is_signed_and_asks_for_no_square_target() -> None:
    for normal in (FACING, TILTED):
        assert flat_figures([flat(normal)], 500.0).z_accuracy_percent == pytest.approx(0.0, abs=0.02)
        assert flat_figures([flat(normal)], 495.0).z_accuracy_percent == pytest.approx(100 * 5 / 495, abs=0.02)
    assert flat_figures([flat(TILTED)]).tilt_deg == pytest.approx(np.degrees(np.arccos(TILTED[2])), abs=0.05)
    assert flat_figures([flat()]).z_accuracy_percent is None


def test_the_fill_rate_counts_the_region_and_nothing_else() -> None:
    shown = flat()
    roi = Patch(100, 100, 100, 100)
    shown.inverse_px[:] = np.nan
    shown.inverse_px[100:200, 100:175] = 190.0
    assert flat_figures([shown], roi=roi).fill_percent == pytest.approx(75.0)


def test_temporal_noise_is_that_of_a_pixel_over_frames() -> None:
    frames = [flat(noise_px=0.1, seed=seed) for seed in range(6)]
    one = flat_figures(frames)
    assert one.frames == 6
    assert one.temporal_rms_mm == pytest.approx(500.0**2 / SCALE_PX * 0.1, rel=0.03)
    assert one.temporal_noise_mm == pytest.approx(500.0**2 / SCALE_PX * 0.1, rel=0.1)
    assert flat_figures(frames[:1]).temporal_noise_mm is None
    assert flat_figures([frames[0], frames[0]]).temporal_rms_mm == 0.0


def test_a_target_without_depth_is_refused() -> None:
    shown = flat()
    shown.inverse_px[:] = np.nan
    with pytest.raises(UsageError, match="let the target fill the region"):
        flat_figures([shown])
    with pytest.raises(UsageError, match="0 frames"):
        flat_figures([])
    with pytest.raises(UsageError, match="several sizes"):
        flat_figures([flat(), replace(flat(), inverse_px=np.ones((10, 10)))])


def test_depth_is_off_by_what_disparity_is_off_by() -> None:
    true = np.geomspace(400.0, 3000.0, 100_000)
    found = SCALE_PX / (SCALE_PX / true + np.random.default_rng(3).normal(0, 0.1, true.shape))
    for one in truth_bins(found, true, SCALE_PX):
        assert one.errors is not None
        assert one.errors.disparity_rms_px == pytest.approx(0.1, rel=0.05)
        assert one.errors.depth_rms_mm == pytest.approx(one.errors.predicted_rms_mm, rel=0.06)
        assert abs(one.errors.depth_bias_percent) < 0.05 * one.to_mm / 400


def test_a_wrong_scale_shows_as_a_bias_that_grows_with_disparity_and_an_offset_as_one_that_does_not() -> None:
    true = np.geomspace(400.0, 3000.0, 50_000)
    scaled = truth_bins(true * 1.002, true, SCALE_PX)
    shifted = truth_bins(SCALE_PX / (SCALE_PX / true + 0.2), true, SCALE_PX)
    biases = [[one.errors.disparity_bias_px for one in bins if one.errors] for bins in (scaled, shifted)]
    assert biases[0][0] == pytest.approx(biases[0][-1] * 6, rel=0.35)
    np.testing.assert_allclose(biases[1], 0.2, atol=1e-6)
    assert [round(one.errors.depth_bias_percent, 6) for one in scaled if one.errors] == [0.2] * len(scaled)


def test_wrong_matches_and_holes_are_counted_apart() -> None:
    true = np.full(10_000, 1000.0)
    found = true.copy()
    found[:1000] = np.nan
    found[1000:1900] = 700.0
    (one,) = truth_bins(found, true, SCALE_PX)
    assert (one.fill_percent, one.bad_percent) == (pytest.approx(90.0), pytest.approx(10.0))
    (none,) = truth_bins(np.full(100, np.nan), np.full(100, 1000.0), SCALE_PX)
    assert (none.fill_percent, none.errors) == (0.0, None)
    with pytest.raises(UsageError, match="no pixel of which the true depth is known"):
        truth_bins(found, np.full(10_000, np.nan), SCALE_PX)


def test_levels_are_whole_disparities_and_single_wrong_matches_are_none() -> None:
    ramp = np.repeat(np.arange(20, 121, dtype=np.float32), 1000)
    counted = levels([np.concatenate([ramp, [300.0, np.nan]]).astype(np.float32)])
    assert (counted.first, counted.in_use, counted.span) == (20, 101, 101)
    assert levels([np.full((3, 3), np.nan, np.float32)]).in_use == 0


def test_the_gap_of_noisy_corners_is_the_half_normal_one() -> None:
    made, rng = unit(), np.random.default_rng(4)
    rig_points = rng.uniform([-10, -30, 360], [60, 30, 400], (4000, 3))
    views = [fold(Rig.read("dslr-35mm"), side) for side in ("left", "right")]
    lens = made.left.lens
    pixels = [lens.project_slopes(view.slopes(rig_points)) + rng.normal(0, 0.2, (4000, 2)) for view in views]
    found = Gap.of("corners", made, *pixels)
    assert found is not None
    assert found.mean == pytest.approx(1.128 * 0.2 * found.distance_mm / made.focal_px, rel=0.06)
    assert found.noise_px == pytest.approx(0.2, rel=0.05)
    assert found.variance / found.mean**2 == pytest.approx(np.pi / 2 - 1, rel=0.1)


def test_the_report_holds_everything_and_loads_nothing() -> None:
    made = account()
    page = html(replace(made, flat=(replace(made.flat[0], source="<b>&"),)), compare(account(0.05), made))
    assert "<b>&" not in page
    assert "&lt;b&gt;&amp;" in page
    assert not re.search(r"https?:|<script|src=|url\(", page.replace("default-src", ""))
    assert page.count("<svg") == 5
    assert all(name in page for name in DEFINITIONS)
    assert "worse" in page
    assert page == html(replace(made, flat=(replace(made.flat[0], source="<b>&"),)), compare(account(0.05), made))


def test_an_account_comes_back_from_its_file(tmp_path: Path) -> None:
    made, path = account(), tmp_path / "quality.json"
    path.write_bytes(msgspec.json.encode({**made.told(), "compared": [], "report": None}))
    assert read(path) == made
    for content in (b"", b"{}", b"[1]", b'{"schema": "prismstereo-quality/9"}', b"\xff\xfe", b"[" * 100_000):
        path.write_bytes(content)
        with pytest.raises(DataError, match="no quality report"):
            read(path)
    with pytest.raises(DataError, match="cannot read"):
        read(tmp_path / "absent.json")


def test_what_became_better_and_what_worse_is_said() -> None:
    changes = {(one.figure, one.where): one.verdict for one in compare(account(0.1, holes=0.1), account(0.05))}
    assert changes["sub-pixel RMS, px", "flat, 500 mm"] == "better"
    assert changes["fill rate, %", "flat, 500 mm"] == "better"
    assert {one.verdict for one in compare(account(), account())} == {"same"}
    back = {(one.figure, one.where): one.verdict for one in compare(account(0.05), account(0.1, holes=0.1))}
    assert back["sub-pixel RMS, px", "flat, 500 mm"] == "worse"
    assert back["fill rate, %", "flat, 500 mm"] == "worse"
    far = flat_figures([flat(distance_mm=900.0)])
    assert not compare(Account((replace(account().flat[0], figures=far),), ()), Account(account().flat, ()))
