"""Growing Correspondence Seeds: maps are right where the truth is known, parameters are checked, and manners are good."""

from __future__ import annotations

import logging
import math
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from device.shifted_noise import grey, noise, shifted
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.compiled import compiled
from prismstereo_device.match.base import Found, Search
from prismstereo_device.match.growing import matcher
from prismstereo_device.match.growing.growing_kernels import grow, matched_along_rows, refined
from prismstereo_device.match.growing.matcher import GrowingMatcher, warm_up
from prismstereo_device.match.growing.seeds import harris_corners, map_seeds, random_seeds
from prismstereo_device.match.growing.selection_kernels import listed, selected
from prismstereo_device.match.growing.settings import PRESETS, GrowingSettings
from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.reasons import Reason
from prismstereo_device.rectify import RectifiedPair
from prismstereo_hw.errors import UsageError
from sgbm_anchor import sgbm_anchor

DENSE = PRESETS["dense"]


def found_by(
    left: np.ndarray, right: np.ndarray, labels: int, growing: GrowingSettings = DENSE, **kwargs: int
) -> Found:
    return GrowingMatcher(growing=growing).search(left, right, Search(labels, **kwargs))


# ---- maps of scenes whose truth is known


def test_a_moved_picture_comes_back_at_every_fraction_of_a_pixel(rng: np.random.Generator) -> None:
    picture = noise(rng, 60, 120)
    for shift_px, least in ((4.0, 0.99), (6.25, 0.95), (7.5, 0.85)):  # halfway two pixels often want one partner
        found = found_by(grey(picture), grey(shifted(picture, shift_px)), 16).disparity_px[:, 12:-12]
        off = found - shift_px
        assert np.isfinite(off).mean() > least
        assert abs(np.nanmean(off)) < 0.05
        assert np.sqrt(np.nanmean(off**2)) < 0.15


def test_what_stands_before_something_hides_it_and_the_map_says_so(rng: np.random.Generator) -> None:
    behind, before = noise(rng, 60, 140), noise(rng, 60, 40)
    left, right = behind.copy(), np.roll(behind, -2, axis=1)
    left[:, 60:100] = before
    right[:, 48:88] = before  # disparity 12 before disparity 2: left columns 50..59 are not seen from the right
    found = found_by(grey(left), grey(right), 20)
    assert np.nanmedian(found.disparity_px[:, 65:95]) == pytest.approx(12, abs=0.1)
    assert np.nanmedian(found.disparity_px[:, 105:130]) == pytest.approx(2, abs=0.1)
    hidden = found.reasons[5:55, 52:58]
    assert np.isfinite(found.disparity_px[5:55, 52:58]).mean() < 0.05
    assert (hidden != Reason.WEAK_TEXTURE).all()
    confident = found.confidence[5:55, 70:90]
    assert np.median(confident) > 150
    np.testing.assert_array_equal(found.confidence == 0, np.isnan(found.disparity_px))
    np.testing.assert_array_equal(found.reasons == Reason.MATCHED, np.isfinite(found.disparity_px))


def test_flat_is_weak_texture_and_repeated_is_ambiguous(rng: np.random.Generator) -> None:
    left = noise(rng, 60, 120)
    left[15:45, 40:80] = 200.0
    found = found_by(grey(left), grey(np.roll(left, -5, axis=1)), 16)
    assert (found.reasons[19:41, 44:76] == Reason.WEAK_TEXTURE).all()
    assert (found.reasons[:12, 10:-10] == Reason.MATCHED).mean() > 0.95
    stripes = grey(np.tile(noise(rng, 60, 6), (1, 20)))  # the same again every six pixels
    again = found_by(stripes, stripes, 24, replace(DENSE, seeds="random")).reasons[:, 24:-12]
    assert (again == Reason.AMBIGUOUS).mean() > 0.95


def test_under_the_ordering_constraint_nothing_crosses(rng: np.random.Generator) -> None:
    behind, pole = noise(rng, 40, 120), noise(rng, 40, 8)
    left, right = behind.copy(), np.roll(behind, -2, axis=1)
    left[:, 60:68] = pole
    right[:, 44:52] = pole  # a thin pole at 16 jumps over what is left of it
    free, ordered = (
        found_by(grey(left), grey(right), 24, replace(DENSE, ordering=on)).disparity_px for on in (False, True)
    )
    columns = np.arange(120)
    crossings = []
    for disparity in (free, ordered):
        partners = [(columns - row)[np.isfinite(row)] for row in disparity]
        crossings.append(sum(int((np.diff(places) < 0).sum()) for places in partners))
    assert crossings[0] > 20
    assert crossings[1] == 0
    assert np.isfinite(ordered).mean() > 0.7


def test_the_map_hardly_depends_on_where_growing_began(rng: np.random.Generator) -> None:
    picture = noise(rng, 60, 120)
    left, right = grey(picture + rng.normal(0, 4, picture.shape)), grey(np.roll(picture, -6, axis=1))
    cornered = found_by(left, right, 16).disparity_px
    drawn = found_by(left, right, 16, replace(DENSE, seeds="random", random_seeds=2000)).disparity_px
    single = GrowingMatcher(growing=DENSE).search_from(left, right, Search(16), np.array([[30, 60, 6]])).disparity_px
    for other in (drawn, single):
        assert (np.isfinite(other) == np.isfinite(cornered)).mean() > 0.97
        assert np.nanmax(np.abs(other - cornered)) < 1
    everything = found_by(left, right, 16, PRESETS["random"]).disparity_px
    assert np.nanmean(np.abs(everything - 6) > 1) < 0.01


def test_a_last_map_helps_and_a_wrong_one_does_no_harm(rng: np.random.Generator) -> None:
    picture = noise(rng, 60, 120)
    left, right = grey(picture), grey(np.roll(picture, -6, axis=1))
    bare = replace(DENSE, harris_share=0.0)
    truth, lie = np.full((60, 120), 6.0, np.float32), np.full((60, 120), 11.0, np.float32)
    assert np.isnan(found_by(left, right, 16, bare).disparity_px).all()
    helped = found_by(left, right, 16, bare, hint=truth).disparity_px
    assert np.isfinite(helped[:, 8:]).mean() > 0.95
    cold, harmed = found_by(left, right, 16).disparity_px, found_by(left, right, 16, hint=lie).disparity_px
    assert (np.isfinite(cold) == np.isfinite(harmed)).mean() > 0.99


def test_more_threads_give_the_same_bits(rng: np.random.Generator) -> None:
    picture = noise(rng, 50, 100)
    left, right = grey(picture + rng.normal(0, 6, picture.shape)), grey(shifted(picture, 5.3))
    one, two, three, sixty = (found_by(left, right, 16, threads=threads) for threads in (1, 2, 3, 60))
    for other in (two, three, sixty):
        np.testing.assert_array_equal(one.disparity_px, other.disparity_px)
        np.testing.assert_array_equal(one.confidence, other.confidence)
        np.testing.assert_array_equal(one.reasons, other.reasons)


def test_a_picture_too_large_for_one_piece_is_searched_in_strips(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = noise(rng, 90, 100)
    left, right = grey(picture), grey(np.roll(picture, -4, axis=1))
    hint = np.full((90, 100), 4.0, np.float32)
    whole = found_by(left, right, 16, hint=hint).disparity_px
    monkeypatch.setattr(matcher, "_MOST_PIXELS", 35 * 100)
    parts = found_by(left, right, 16, hint=hint).disparity_px
    assert parts.shape == (90, 100)
    assert (np.isfinite(whole) == np.isfinite(parts)).mean() > 0.99
    assert np.nanmax(np.abs(whole - parts)) < 0.5


# ---- shapes, settings, manners


@pytest.mark.parametrize("shape", [(1, 1), (1, 200), (200, 1), (2, 2), (5, 9)])
@pytest.mark.parametrize("labels", [1, 16, 1024])
@pytest.mark.parametrize("preset", ["dense", "random"])
def test_the_smallest_pictures_give_a_map_of_their_size(
    shape: tuple[int, int], labels: int, preset: str, rng: np.random.Generator
) -> None:
    picture = rng.integers(0, 256, shape, np.uint8)
    window = DisparityWindow(labels)
    found = GrowingMatcher(growing=PRESETS[preset]).match(RectifiedPair(picture, picture, window))
    assert found.disparity_px.shape == shape
    values = found.disparity_px[found.valid]
    assert np.all((values >= 0) & (values <= labels - 1))


def test_a_row_of_one_pixel_is_matched_like_any_other(rng: np.random.Generator) -> None:
    row = noise(rng, 40, 200)[20:21]
    found = found_by(grey(row), grey(np.roll(row, -7, axis=1)), 16, replace(DENSE, seeds="random"))
    assert np.nanmedian(found.disparity_px) == pytest.approx(7, abs=0.1)


@pytest.mark.parametrize("preset", list(PRESETS))
@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_constant_picture_matches_nowhere(preset: str, level: int) -> None:
    flat = np.full((30, 50), level, np.uint8)
    assert np.isnan(found_by(flat, flat, 16, PRESETS[preset]).disparity_px).all()


def test_only_disparities_that_are_searched_are_found_in_sixteenths(rng: np.random.Generator) -> None:
    picture = noise(rng, 50, 120)
    left, right = grey(picture), grey(shifted(picture, 9.3))
    for first, labels in ((0, 9), (10, 20), (9, 10), (3, 16)):
        found = found_by(left, right, labels, first=first).disparity_px
        values = found[np.isfinite(found)]
        assert np.all((values >= first) & (values <= labels - 1))
        np.testing.assert_array_equal(values * 16, np.rint(values * 16))
    pair = RectifiedPair(left, right, DisparityWindow(16))
    region = GrowingMatcher(MatchSettings(region=(40, 10, 30, 20))).match(pair).valid
    assert region[12:28, 42:68].mean() > 0.9
    assert region.sum() == region[10:30, 40:70].sum()


def test_a_quarter_of_the_corners_are_the_strongest_quarter(rng: np.random.Generator) -> None:
    picture = grey(noise(rng, 60, 80))
    every, some = harris_corners(picture, 1.0), harris_corners(picture, 0.25)
    assert len(some) == math.ceil(len(every) / 4)
    np.testing.assert_array_equal(some, every[: len(some)])


def test_seeds_lie_where_a_search_may_look() -> None:
    drawn = random_seeds((20, 30), 3, 12, GrowingSettings(random_seeds=500))
    assert len(drawn) > 200
    assert ((drawn[:, 2] >= 3) & (drawn[:, 2] < 12) & (drawn[:, 2] <= drawn[:, 1])).all()
    before = np.full((8, 9), np.nan, np.float32)
    before[4, 8], before[0, 4], before[4, 4] = 5.4, 5.0, 99.0
    np.testing.assert_array_equal(map_seeds(before, 0, 16), [[4, 8, 5]])


@pytest.mark.parametrize("seed", [(30, 5, 2), (-1, 5, 2), (3, 50, 2), (3, 5, 6), (3, 40, 16), (3, 40, 1)])
def test_a_seed_outside_of_the_search_is_refused(seed: tuple[int, int, int]) -> None:
    picture = np.zeros((30, 50), np.uint8)
    with pytest.raises(UsageError, match=r"seed .* lies outside of the pictures of 50x30 or of the search 2 to 15"):
        GrowingMatcher().search_from(picture, picture, Search(16, first=2), np.array([(3, 20, 5), seed]))


@pytest.mark.parametrize(
    "wrong",
    [
        {"tau": 1.5}, {"tau": math.nan}, {"tau": math.inf}, {"mu": -0.1}, {"beta": math.nan}, {"epsilon": 3.0},
        {"zonegap": -1}, {"max_hypotheses": 0}, {"max_hypotheses": 65}, {"harris_share": 1.1},
        {"seed_correlation": math.nan}, {"random_seeds": -1}, {"random_seed": -1}, {"noise_grey": -1.0},
        {"seeds": "sift"},
    ],
)  # fmt: skip
def test_parameters_that_cannot_be_are_refused_by_name(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError, match=f"{next(iter(wrong))} (is|are) .*: give "):
        GrowingSettings(**wrong)


def test_the_defaults_are_the_published_ones() -> None:
    defaults = GrowingSettings()
    assert (defaults.tau, defaults.mu, defaults.beta, defaults.zonegap) == (0.6, 0.1, 0.1, 3)
    assert defaults.max_hypotheses == 10
    assert (DENSE.tau, DENSE.mu, DENSE.beta) == (0.4, 0.05, 0.05)


def test_compiling_in_the_background_says_so_once(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        thread = warm_up()
    thread.join(60)
    assert not thread.is_alive()
    assert [record.message.split(":")[0] for record in caplog.records] == [
        "the growing matcher is being compiled in the background"
    ]
    for kernel in (grow, matched_along_rows, listed, selected, refined):
        assert len(kernel.signatures) == 1  # no other search here has called for another machine code


def test_where_no_folder_can_be_written_loops_are_compiled_in_memory() -> None:
    scope: dict[str, object] = {}
    exec(compile("def doubled(x):\n    return 2 * x", "<no file, so no folder beside it>", "exec"), scope)
    doubled = compiled(scope["doubled"])
    assert doubled(21) == 42
    assert doubled.signatures  # compiled, though numba finds no place for its cache


# ---- real pictures with known truth


def real_pair(data: Path, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    folder, left, right, truth, scale, labels = {
        "teddy": ("gt-middlebury/teddy", "im2.png", "im6.png", "disp2.png", 4, 64),
        "moebius": ("gt-middlebury/moebius_third", "view1.png", "view5.png", "disp1.png", 3, 80),
        "tsukuba": ("gt-middlebury/tsukuba", "im3.png", "im4.png", "disp3.pgm", 16, 16),
        "aloe": ("gt-aloe-full", "aloeL.jpg", "aloeR.jpg", "aloeGT.png", 1, 224),
        "terrace": ("gt-eth3d-terrace", "im0.png", "im1.png", "disp0.pfm", 1, 32),
    }[name]
    pictures = [cv2.imread(str(data / folder / file), cv2.IMREAD_GRAYSCALE) for file in (left, right)]
    known = cv2.imread(str(data / folder / truth), cv2.IMREAD_UNCHANGED).astype(np.float32) / scale
    return pictures[0], pictures[1], np.where(np.isfinite(known) & (known > 0), known, np.nan), labels


def seen_from_the_right(truth: np.ndarray) -> np.ndarray:
    """Where the truth is not hidden: nothing nearer lands on the same right pixel or on both of its neighbours."""
    seen = np.zeros(truth.shape, bool)
    for y, row in enumerate(truth):
        nearest = np.full(row.size + 2, -1.0)
        columns = np.flatnonzero(np.isfinite(row) & (np.arange(row.size) - row > -0.5))
        partners = np.rint(columns - row[columns]).astype(int) + 1
        np.maximum.at(nearest, partners, row[columns])
        over = np.minimum(nearest[partners - 1], nearest[np.minimum(partners + 1, row.size + 1)])
        seen[y, columns] = row[columns] >= np.maximum(nearest[partners], over) - 1
    return seen


def quality(disparity: np.ndarray, truth: np.ndarray, seen: np.ndarray) -> tuple[float, float, float]:
    """Density, bad-2 of matched, and bad-2 with unmatched as bad, percent of the pixels seen from both sides."""
    matched, bad = np.isfinite(disparity[seen]), np.abs(disparity[seen] - truth[seen]) > 2
    return 100 * matched.mean(), 100 * bad[matched].mean(), 100 * (bad | ~matched).mean()


def test_teddy_is_matched_sparsely_and_well(data: Path) -> None:
    left, right, truth, labels = real_pair(data, "teddy")
    density, bad, _ = quality(found_by(left, right, labels).disparity_px, truth, seen_from_the_right(truth))
    assert density > 75  # reached: 77.1 / 3.5; semi-global matching: 88.5 / 5.0
    assert bad < 4.2


def timed_maps(left: np.ndarray, right: np.ndarray, labels: int) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Maps of SGBM and of three growers, and processor time over SGBM's: medians of three interleaved rounds."""
    sgbm = sgbm_anchor(labels)
    growers = {preset: GrowingMatcher(growing=PRESETS[preset]) for preset in ("published", "dense", "dgrow0")}
    seconds: dict[str, list[float]] = defaultdict(list)
    maps: dict[str, np.ndarray] = {}
    for _ in range(3):
        began = time.process_time()
        steps = sgbm.compute(left, right)
        seconds["sgbm"].append(time.process_time() - began)
        maps["sgbm"] = np.where(steps < 0, np.nan, steps.astype(np.float32) / 16)
        for preset, grower in growers.items():
            began = time.process_time()
            maps[preset] = grower.search(left, right, Search(labels)).disparity_px
            seconds[preset].append(time.process_time() - began)
    return maps, {method: float(np.median(took) / np.median(seconds["sgbm"])) for method, took in seconds.items()}


@pytest.mark.soak
def test_what_is_matched_in_real_pairs_is_righter_than_with_semi_global_matching(data: Path) -> None:
    warm_up().join()
    scores = defaultdict(list)
    for name in ("teddy", "moebius", "tsukuba", "aloe", "terrace"):
        left, right, truth, labels = real_pair(data, name)
        seen = seen_from_the_right(truth)
        maps, ratios = timed_maps(left, right, labels)
        for method, disparity in maps.items():
            density, bad, lost = quality(disparity, truth, seen)
            scores[method].append((density, bad, lost))
            print(
                f"{name:8} {method:10} {density:5.1f} / {bad:4.1f} / {lost:5.1f} %, time {ratios[method]:5.1f} x SGBM's"
            )
    means = {method: np.mean(of_pairs, axis=0) for method, of_pairs in scores.items()}
    assert means["published"][1] < 0.7 * means["sgbm"][1]
    assert means["dense"][1] < means["sgbm"][1]
    assert means["dense"][0] > means["published"][0] > 50
