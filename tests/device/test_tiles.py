"""`tiles` and `semiglobal`: what they find, what they leave unmatched and why, and how hints help."""

from __future__ import annotations

import logging
from pathlib import Path

import cv2
import numpy as np
import pytest

from device.shifted_noise import grey, noise, shifted
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.match.base import Found, Search
from prismstereo_device.match.mask_kernels import settle
from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.match.subpixel_kernels import refine_rows
from prismstereo_device.match.tiles.semiglobal import SemiglobalMatcher
from prismstereo_device.match.tiles.tiles import TilesMatcher
from prismstereo_device.match.tiles.warm_up import warm_up
from prismstereo_device.reasons import Reason
from prismstereo_device.rectify import RectifiedPair
from sgbm_anchor import sgbm_anchor

BOTH = pytest.mark.parametrize("matcher", [TilesMatcher, SemiglobalMatcher])
Sweeper = type[TilesMatcher] | type[SemiglobalMatcher]


@BOTH
@pytest.mark.parametrize("shift_px", [0.0, 3.0, 17.25, 40.5, 126.0])
def test_a_moved_picture_has_one_disparity(matcher: Sweeper, shift_px: float, rng: np.random.Generator) -> None:
    picture = noise(rng, 120, 400)
    found = matcher().search(grey(picture), grey(shifted(picture, shift_px)), Search(128)).disparity_px
    inside = found[10:-10, 150:-10]
    assert np.isfinite(inside).mean() > 0.99
    assert abs(np.nanmedian(inside) - shift_px) < 0.15
    assert np.nanmean(np.abs(inside - shift_px) > 1) < 0.002


@BOTH
@pytest.mark.parametrize(
    ("labels", "first", "true_px"), [(256, 0, 250.0), (600, 0, 511.0), (600, 420, 511.0), (40, 30, 33.0)]
)
def test_many_labels_and_any_first_one(
    matcher: Sweeper, labels: int, first: int, true_px: float, rng: np.random.Generator
) -> None:
    picture = noise(rng, 100, 720)
    right = np.roll(picture, -int(true_px), axis=1)
    found = matcher().search(grey(picture), grey(right), Search(labels, first)).disparity_px
    inside = found[10:-10, int(true_px) + 20 : -10]
    assert np.isfinite(inside).mean() > 0.99
    assert np.nanmedian(inside) == pytest.approx(true_px, abs=0.05)
    assert np.nanmin(found) >= first


@BOTH
@pytest.mark.parametrize("labels", [1, 16, 300])
def test_a_constant_picture_shows_nothing(matcher: Sweeper, labels: int) -> None:
    flat = np.full((70, 100), 200, np.uint8)
    found = matcher().search(flat, flat, Search(labels))
    assert np.isnan(found.disparity_px).all()
    assert found.reasons is not None
    assert (found.reasons == Reason.WEAK_TEXTURE).all()


@BOTH
@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (2, 2), (33, 65), (47, 500)])
@pytest.mark.parametrize("labels", [1, 17, 1024])
def test_any_size_gives_a_map_of_that_size(
    matcher: Sweeper, shape: tuple[int, int], labels: int, rng: np.random.Generator
) -> None:
    picture = rng.integers(0, 256, shape, np.uint8)
    found = matcher().search(picture, picture, Search(labels, labels // 2))
    assert found.disparity_px.shape == shape
    assert found.disparity_px.dtype == np.float32
    values = found.disparity_px[np.isfinite(found.disparity_px)]
    assert ((values >= labels // 2) & (values <= labels - 1)).all()


def steps_in_depth(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A square at 30 px before a wall at 8 px, and where the right view cannot see the wall."""
    wall, square = noise(rng, 160, 300), noise(rng, 160, 300)
    left, right = wall.copy(), np.roll(wall, -8, axis=1)
    left[40:120, 120:200] = square[40:120, 120:200]
    right[40:120, 90:170] = square[40:120, 120:200]
    hidden = np.zeros((160, 300), bool)
    hidden[40:120, 98:120] = True
    return grey(left), grey(right), hidden


@BOTH
def test_what_only_one_view_sees_is_occluded_and_says_so(matcher: Sweeper, rng: np.random.Generator) -> None:
    left, right, hidden = steps_in_depth(rng)
    found = matcher().search(left, right, Search(48))
    assert found.reasons is not None
    assert np.isnan(found.disparity_px[hidden]).mean() > 0.8
    reasons = found.reasons[hidden & np.isnan(found.disparity_px)]
    assert np.isin(reasons, [Reason.OCCLUDED, Reason.AMBIGUOUS]).mean() > 0.9
    assert np.nanmedian(found.disparity_px[50:110, 130:190]) == pytest.approx(30, abs=0.1)
    assert np.nanmedian(found.disparity_px[5:35, 60:290]) == pytest.approx(8, abs=0.1)


def told(found: Found) -> tuple[np.ndarray, np.ndarray]:
    assert found.confidence is not None
    assert found.reasons is not None
    return found.confidence, found.reasons


@BOTH
def test_every_unmatched_pixel_has_a_reason_and_no_confidence(matcher: Sweeper, rng: np.random.Generator) -> None:
    left, right, _ = steps_in_depth(rng)
    found = matcher().search(left, right, Search(48))
    confidence, reasons = told(found)
    matched = np.isfinite(found.disparity_px)
    np.testing.assert_array_equal(reasons == Reason.MATCHED, matched)
    np.testing.assert_array_equal(confidence > 0, matched)
    assert np.isnan(found.disparity_px[125:, :7]).mean() > 0.95  # partners left of the right picture
    assert (reasons[125:, :7] == Reason.OUTSIDE).any()


@BOTH
def test_pictures_of_different_things_hardly_match_and_say_why(matcher: Sweeper, rng: np.random.Generator) -> None:
    found = matcher().search(grey(noise(rng, 120, 200)), grey(noise(rng, 120, 200)), Search(64))
    _, reasons = told(found)
    assert np.isfinite(found.disparity_px).mean() < 0.1
    assert np.isin(reasons[:, 70:], [Reason.OCCLUDED, Reason.AMBIGUOUS, Reason.FILTERED]).mean() > 0.85


@BOTH
def test_confidence_falls_with_noise(matcher: Sweeper, rng: np.random.Generator) -> None:
    picture = noise(rng, 100, 200)
    left, right = grey(picture), grey(np.roll(picture, -9, axis=1))
    noisy = grey(right + rng.normal(0, 12, right.shape))
    clean, worse = (told(matcher().search(left, other, Search(64)))[0] for other in (right, noisy))
    assert np.mean(clean[20:-20, 80:-20]) > 1.05 * np.mean(worse[20:-20, 80:-20])


def test_what_is_new_is_found_whatever_the_frame_before_was(rng: np.random.Generator) -> None:
    left, right, _ = steps_in_depth(rng)
    cold = TilesMatcher().search(left, right, Search(48)).disparity_px
    wrong = np.full(cold.shape, 20, np.float32)  # a cut: all of the map before is wrong
    warm = TilesMatcher().search(left, right, Search(48, hint=wrong)).disparity_px
    true_px = np.full(cold.shape, 8.0)
    true_px[40:120, 120:200] = 30
    bad = [np.mean(~(np.abs(found - true_px) <= 2)) for found in (cold, warm)]
    assert bad[1] <= bad[0] + 0.003


def test_a_hint_brings_back_what_the_coarse_pass_cannot_see(rng: np.random.Generator) -> None:
    # a rod of two columns, 24 px nearer than the wall: a coarse pixel mixes it with the wall
    wall, rod = noise(rng, 160, 300), noise(rng, 160, 300)
    left, right = wall.copy(), np.roll(wall, -6, axis=1)
    left[:, 150:153] = rod[:, 150:153]
    right[:, 120:123] = rod[:, 150:153]
    hint = np.full((160, 300), np.nan, np.float32)
    hint[:, 148:155] = 30
    cold, warm = (
        TilesMatcher().search(grey(left), grey(right), Search(48, hint=given)).disparity_px for given in (None, hint)
    )
    found = [np.mean(np.abs(disparity[:, 150:153] - 30) < 1) for disparity in (cold, warm)]
    assert found[1] >= found[0]
    np.testing.assert_allclose(np.nanmedian(warm[:, 200:]), 6, atol=0.1)


def test_a_refinement_of_ones_own_finds_the_fractions(rng: np.random.Generator) -> None:
    picture = noise(rng, 90, 200)
    left, right = grey(picture), grey(np.roll(picture, -21, axis=1))
    seen: list[np.ndarray] = []

    def to_a_plane(left: np.ndarray, right: np.ndarray, steps: np.ndarray, threads: int) -> np.ndarray:
        seen.append(steps)
        return np.where(steps >= 0, 21 * 16 + 4, steps).astype(np.int16)

    found = TilesMatcher(refine=to_a_plane).search(left, right, Search(64, 10)).disparity_px
    assert seen[0].shape == left.shape
    assert np.median(seen[0][seen[0] >= 0]) == pytest.approx(21 * 16, abs=2)
    values = found[np.isfinite(found)]
    assert values.size > 0.8 * left.size
    np.testing.assert_array_equal(values, 21.25)


def test_the_matchers_work_behind_the_interface(rng: np.random.Generator) -> None:
    picture = noise(rng, 90, 240)
    pair = RectifiedPair(grey(picture), grey(np.roll(picture, -13, axis=1)), DisparityWindow(64))
    settings = MatchSettings(region=(100, 20, 90, 50), threads=3)
    found = TilesMatcher(settings).match(pair)
    assert found.density == pytest.approx(90 * 50 / (90 * 240), rel=0.02)
    assert np.nanmedian(found.disparity_px) == pytest.approx(13, abs=0.05)
    assert found.reasons is not None
    assert (found.reasons[:20] == Reason.OUTSIDE).all()


def test_the_kernels_are_compiled_in_the_background_and_say_so(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        thread = warm_up(labels=64)
        assert "being compiled" in caplog.text
        thread.join(120)
    assert not thread.is_alive()
    assert "ready after" in caplog.text
    for kernel in (refine_rows, settle):  # the first frame meets them too
        assert kernel.signatures


# ---- real pictures with known truth


def anchor(left: np.ndarray, right: np.ndarray, labels: int) -> np.ndarray:
    steps = sgbm_anchor(labels).compute(left, right)
    return np.where(steps < 0, np.nan, steps / 16.0)


def bad2(found: np.ndarray, true_px: np.ndarray) -> tuple[float, float]:
    """Shares of known pixels more than 2 px off: unmatched counted as bad, and of the matched alone."""
    known = true_px > 0
    off = np.abs(found - true_px)
    return float(np.mean(~(off[known] <= 2))), float(np.mean(off[known & np.isfinite(found)] > 2))


PAIRS = [
    ("teddy/im2.png", "teddy/im6.png", "teddy/disp2.png", 4, 64),
    ("moebius_third/view1.png", "moebius_third/view5.png", "moebius_third/disp1.png", 3, 80),
]


def pictures(data: Path, names: tuple[str, str, str]) -> list[np.ndarray]:
    found = [cv2.imread(str(data / "gt-middlebury" / name), cv2.IMREAD_GRAYSCALE) for name in names]
    if any(picture is None for picture in found):
        pytest.skip(f"real data: {names[0]} is not there")
    return [np.asarray(picture) for picture in found]


@pytest.mark.parametrize(("left", "right", "truth", "scale", "labels"), PAIRS)
def test_real_pairs_are_matched_better_than_by_sgbm_also_with_noise_and_a_gain_ramp(
    data: Path, left: str, right: str, truth: str, scale: int, labels: int, rng: np.random.Generator
) -> None:
    one, other, known = pictures(data, (left, right, truth))
    true_px = known / scale
    ours, matched = bad2(TilesMatcher().search(one, other, Search(labels)).disparity_px, true_px)
    whole, whole_matched = bad2(SemiglobalMatcher().search(one, other, Search(labels)).disparity_px, true_px)
    theirs, theirs_matched = bad2(anchor(one, other, labels), true_px)
    assert ours < 0.85 * theirs  # on all pixels, the occluded ones too, which nobody can match
    assert whole < 0.85 * theirs
    assert max(matched, whole_matched) < theirs_matched

    ramp = np.linspace(0.75, 0.95, other.shape[1])
    noisy = [grey(picture + rng.normal(0, 3, one.shape)) for picture in (one, other * ramp + 6)]
    assert (
        bad2(TilesMatcher().search(*noisy, Search(labels)).disparity_px, true_px)[0]
        < bad2(anchor(*noisy, labels), true_px)[0]
    )


@pytest.mark.soak
@pytest.mark.parametrize("motion_px", [0, 6, 24])
def test_hints_of_the_frame_before_never_cost_more_than_the_third_of_a_point(data: Path, motion_px: int) -> None:
    names = ("aloeL.jpg", "aloeR.jpg", "aloeGT.png")
    whole = [cv2.imread(str(data / "gt-aloe-full" / name), cv2.IMREAD_GRAYSCALE) for name in names]
    if any(picture is None for picture in whole):
        pytest.skip("real data: aloe is not there")
    rng, cold, warm, hint = np.random.default_rng(7), [], [], None
    for frame in range(30):
        x = 200 + abs((frame * motion_px + 500) % 1000 - 500)
        left, right, truth = (np.ascontiguousarray(np.asarray(picture)[300:780, x : x + 560]) for picture in whole)
        left, right = (grey(picture + rng.normal(0, 1.5, picture.shape)) for picture in (left, right))
        matcher = TilesMatcher()
        alone = matcher.search(left, right, Search(224))
        helped = matcher.search(left, right, Search(224, hint=hint))
        hint = helped.disparity_px
        true_px = truth.astype(np.float64)
        true_px[true_px > np.arange(560)] = 0
        cold.append(bad2(alone.disparity_px, true_px)[0])
        warm.append(bad2(helped.disparity_px, true_px)[0])
    print(
        f"motion {motion_px} px/frame: bad-2 cold {100 * np.mean(cold):.2f} %, with hints {100 * np.mean(warm):.2f} %"
    )
    assert np.mean(warm) <= np.mean(cold) + 0.003
