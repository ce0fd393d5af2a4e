"""OpenCV's one-pass matchers: exact shifts found, searches kept to what was asked, the same from any number of threads."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from device.shifted_noise import grey, noise, shifted
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.match.base import Matcher
from prismstereo_device.match.opencv import BlockMatcher, SgbmMatcher, ThreeWayMatcher
from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.reasons import Reason
from prismstereo_device.rectify import RectifiedPair
from sgbm_anchor import sgbm_anchor

ONE_PASS = (ThreeWayMatcher, BlockMatcher)
ALL = (*ONE_PASS, SgbmMatcher)


def matched(
    kind: type[Matcher], left: np.ndarray, right: np.ndarray, labels: int = 32, **settings: int
) -> DisparityMap:
    return kind(MatchSettings(**settings)).match(RectifiedPair(left, right, DisparityWindow(labels)))


@pytest.mark.parametrize("kind", ONE_PASS)
@pytest.mark.parametrize("shift_px", [1.0, 8.0, 8.3, 30.0])
def test_a_shift_is_found_everywhere_within_half_a_pixel(
    kind: type[Matcher], shift_px: float, rng: np.random.Generator
) -> None:
    picture = noise(rng, 80, 200)
    found = matched(kind, grey(picture), grey(shifted(picture, shift_px))).disparity_px
    inside = found[:, 40:-12]  # beside the left 32 columns too, to the first and the last row
    assert np.isfinite(inside).mean() > 0.99
    assert np.nanmax(np.abs(inside - shift_px)) < 0.45  # SGBM leans to whole pixels


@pytest.mark.parametrize("kind", ALL)
def test_the_columns_that_opencv_leaves_out_are_matched(kind: type[Matcher], rng: np.random.Generator) -> None:
    picture = noise(rng, 80, 200)
    found = matched(kind, grey(picture), grey(np.roll(picture, -8, axis=1)), labels=128).disparity_px
    assert np.isfinite(found[:, 16:128]).mean() > 0.95
    assert np.isnan(found[:, :7]).all()  # partners left of the picture


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("first_px", [5, 16, 17])
def test_a_search_begins_where_it_is_told_to(kind: type[Matcher], first_px: int, rng: np.random.Generator) -> None:
    picture = noise(rng, 80, 200)
    left = grey(picture)
    above, below = (
        matched(kind, left, grey(shifted(picture, shift_px)), labels=48, first_px=first_px)
        for shift_px in (first_px + 2.0, first_px - 3.0)
    )
    assert np.nanmedian(above.disparity_px) == pytest.approx(first_px + 2, abs=0.1)
    assert np.isfinite(above.disparity_px[:, 48:-12]).mean() > 0.95
    assert below.density < 0.05
    assert below.reasons is not None
    assert np.mean(below.reasons[:, 48:-12] == Reason.TOO_FAR) > 0.3  # the rest: contradicted, or no clear winner


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize(("labels", "first_px"), [(1, 0), (17, 16), (33, 7), (1024, 0), (1024, 1000)])
@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (2, 2), (9, 200), (11, 13)])
def test_the_smallest_pictures_give_a_map_of_their_size_in_range(
    kind: type[Matcher], shape: tuple[int, int], labels: int, first_px: int, rng: np.random.Generator
) -> None:
    picture = rng.integers(0, 256, shape, np.uint8)
    found = matched(kind, picture, picture, labels=labels, first_px=first_px)
    values = found.disparity_px[found.valid]
    assert found.disparity_px.shape == shape
    assert np.all((values >= first_px) & (values <= labels - 1))


@pytest.mark.parametrize("kind", ALL)
def test_one_two_and_three_threads_find_the_same_and_leave_opencv_as_it_was(
    kind: type[Matcher], rng: np.random.Generator
) -> None:
    picture = noise(rng, 200, 320)
    left, right = grey(picture), grey(shifted(picture, 11.4))
    before = cv2.getNumThreads()
    one, two, three = (matched(kind, left, right, threads=count).disparity_px for count in (1, 2, 3))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, three)
    assert cv2.getNumThreads() == before


@pytest.mark.parametrize("kind", ALL)
def test_every_pixel_says_whether_it_is_matched_or_why_not(kind: type[Matcher], rng: np.random.Generator) -> None:
    left = noise(rng, 160, 240)
    left[50:110, 80:160] = 128.0
    found = matched(kind, grey(left), grey(np.roll(left, -5, axis=1)))
    assert found.reasons is not None
    np.testing.assert_array_equal(found.reasons == Reason.MATCHED, found.valid)
    np.testing.assert_array_equal(found.reasons[62:98, 92:148], Reason.WEAK_TEXTURE)


@pytest.mark.parametrize("kind", ONE_PASS)
def test_a_region_and_whole_pixels_are_kept_to(kind: type[Matcher], rng: np.random.Generator) -> None:
    picture = noise(rng, 100, 200)
    settings = MatchSettings(region=(60, 20, 80, 40), subpixel_bits=0)
    pair = RectifiedPair(grey(picture), grey(shifted(picture, 8.3)), DisparityWindow(32))
    found = kind(settings).match(pair).disparity_px
    inside = found[20:60, 60:140]
    np.testing.assert_array_equal(inside, np.rint(inside))
    assert np.mean(inside == 8) > 0.95
    found[20:60, 60:140] = np.nan
    assert np.isnan(found).all()


@pytest.mark.parametrize(
    ("kind", "opencvs_own"),
    [
        (ThreeWayMatcher, sgbm_anchor(64, cv2.STEREO_SGBM_MODE_SGBM_3WAY)),
        (BlockMatcher, cv2.StereoBM.create(64, 15)),
    ],
)
def test_teddy_is_matched_as_well_as_by_opencv_and_further_to_the_left(
    data: Path, kind: type[Matcher], opencvs_own: cv2.StereoMatcher
) -> None:
    folder = data / "gt-middlebury" / "teddy"
    if not folder.is_dir():
        pytest.skip(f"real data: {folder} is not there")
    left, right, truth = (cv2.imread(str(folder / f"{name}.png"), 0) for name in ("im2", "im6", "disp2"))
    ours = matched(kind, left, right, labels=64).disparity_px
    theirs = opencvs_own.compute(left, right).astype(np.float32) / 16
    theirs[theirs < 0] = np.nan
    ours_judged, theirs_judged = (np.isfinite(found) & (truth > 0) for found in (ours, theirs))
    ours_bad, theirs_bad = (
        100 * np.mean(np.abs(found - truth / 4)[judged] > 2)
        for found, judged in ((ours, ours_judged), (theirs, theirs_judged))
    )
    assert ours_bad <= theirs_bad + 0.3
    assert (
        ours_judged.mean() > theirs_judged.mean() + 0.05
    )  # OpenCV leaves 64 of 450 columns out, of which we keep those with a partner
