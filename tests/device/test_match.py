"""Matching: depth of planes from the near to the far end, unmatched where nothing matches, and no bad surprises."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from device.shifted_noise import grey, noise
from prismstereo_calibration.rectification import Rectification
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.match import DEFAULT, MATCHERS, create
from prismstereo_device.match.base import Found, Matcher, Search
from prismstereo_device.match.opencv import SgbmMatcher
from prismstereo_device.rectify import RectifiedPair, Rectifier
from prismstereo_device.split import split
from prismstereo_hw.errors import ImageError, UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig

QUARTER_PIXEL = 0.25


def matched(left: np.ndarray, right: np.ndarray, labels: int = 32, **masks: np.ndarray) -> DisparityMap:
    return SgbmMatcher().match(RectifiedPair(left, right, DisparityWindow(labels), **masks))


# ---- depth of planes


@pytest.fixture(scope="module")
def plane_matched(
    rig: Rig, rectified: Rectification, plane_frame: Callable[[float], RawFrame]
) -> Callable[[float], DisparityMap]:
    rectifier = Rectifier(rectified)
    return cache(lambda distance_mm: SgbmMatcher().match(rectifier.rectify(split(plane_frame(distance_mm), rig.views))))


@pytest.mark.parametrize("distance_mm", ["near end", 500.0, 1000.0, 2000.0, 20_000.0])
def test_a_plane_comes_back_at_its_distance_within_a_quarter_pixel_of_depth(
    distance_mm: float | str,
    rig: Rig,
    rectified: Rectification,
    pinhole_z_mm: float,
    plane_matched: Callable[[float], DisparityMap],
) -> None:
    # the near end is a depth, not a distance from the pupil
    window = rectified.window
    z_mm = rig.range.near_mm + pinhole_z_mm if isinstance(distance_mm, str) else distance_mm
    true_mm = z_mm - pinhole_z_mm
    found = plane_matched(z_mm)
    step_mm = true_mm**2 * QUARTER_PIXEL / window.scale_px

    assert found.density > 0.5
    assert np.nanmedian(np.abs(found.depth() - true_mm)) < step_mm
    assert abs(np.nanmedian(found.depth()) - true_mm) < step_mm


def test_a_plane_at_infinity_comes_back_at_disparity_one(
    rectified: Rectification, pinhole_z_mm: float, plane_matched: Callable[[float], DisparityMap]
) -> None:
    found = plane_matched(1e6)
    true_px = rectified.window.scale_px / (1e6 - pinhole_z_mm) - rectified.window.offset_px
    assert 1 < true_px < 1.11
    assert found.density > 0.5
    assert np.nanmedian(np.abs(found.disparity_px - true_px)) < QUARTER_PIXEL
    assert np.nanmin(found.disparity_px) >= 0  # noise at the far end is not clipped, and never negative


def test_hardly_a_match_is_a_pixel_off(
    rectified: Rectification, plane_matched: Callable[[float], DisparityMap]
) -> None:
    found = plane_matched(1000.0)
    off = np.abs(found.disparity_px - np.nanmedian(found.disparity_px))
    assert np.nanmean(off > 1) < 0.002


def test_what_the_views_do_not_both_show_is_unmatched(
    rectified: Rectification, plane_matched: Callable[[float], DisparityMap]
) -> None:
    found = plane_matched(500.0)
    left_seen = np.isfinite(rectified.sources(rectified.left)[..., 0])
    right_seen = np.isfinite(rectified.sources(rectified.right)[..., 0])
    assert np.isnan(found.disparity_px[~left_seen]).all()
    rows, columns = np.nonzero(found.valid)
    partner = columns - found.disparity_px[rows, columns]
    assert partner.min() >= 0
    assert right_seen[rows, np.rint(partner).astype(int)].all()


# ---- what is unmatched


def test_a_constant_picture_matches_nowhere() -> None:
    for level in (0, 128, 255):
        flat = np.full((60, 90), level, np.uint8)
        assert matched(flat, flat).density == 0


def test_two_pictures_of_different_things_hardly_match(rng: np.random.Generator) -> None:
    found = matched(grey(noise(rng, 120, 200)), grey(noise(rng, 120, 200)), labels=64)
    assert found.density < 0.1


def test_a_flat_patch_in_a_busy_picture_is_unmatched_inside(rng: np.random.Generator) -> None:
    left = noise(rng, 160, 240)
    left[50:110, 80:160] = 255.0
    found = matched(grey(left), grey(np.roll(left, -5, axis=1)))
    assert np.isnan(found.disparity_px[62:98, 92:148]).all()
    assert np.nanmedian(found.disparity_px) == pytest.approx(5.0, abs=0.05)


def test_what_the_other_view_does_not_show_is_unmatched(rng: np.random.Generator) -> None:
    picture = noise(rng, 100, 160)
    left, right = grey(picture), grey(np.roll(picture, -8, axis=1))
    found = matched(left, right).disparity_px
    assert np.isnan(found[:, :7]).all()  # partners left of the picture
    assert np.isfinite(found[:, 12:-12]).mean() > 0.95


def test_disparity_zero_is_a_match_like_any_other(rng: np.random.Generator) -> None:
    picture = grey(noise(rng, 100, 160))
    found = matched(picture, picture)
    assert found.density > 0.9
    assert np.nanmax(found.disparity_px) < 0.1


def test_nothing_is_matched_outside_of_the_masks(rng: np.random.Generator) -> None:
    picture = noise(rng, 100, 160)
    left, right = grey(picture), grey(np.roll(picture, -8, axis=1))
    left_seen, right_seen = np.ones((100, 160), bool), np.ones((100, 160), bool)
    left_seen[:20] = False
    right_seen[:, 60:80] = False
    found = matched(left, right, left_seen=left_seen, right_seen=right_seen).disparity_px
    assert np.isnan(found[:20]).all()
    assert np.isnan(found[:, 70:86]).all()  # their partners are in the dark stripe
    assert np.isfinite(found[25:95, 100:150]).mean() > 0.95


def test_masks_that_show_nothing_match_nothing(rng: np.random.Generator) -> None:
    picture = grey(noise(rng, 60, 90))
    nothing = np.zeros((60, 90), bool)
    assert matched(picture, picture, left_seen=nothing).density == 0
    assert matched(picture, picture, right_seen=nothing).density == 0


# ---- shapes and sizes


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (2, 2), (9, 200), (10, 10), (11, 13)])
@pytest.mark.parametrize("labels", [1, 16, 17, 1024])
def test_the_smallest_pictures_give_a_map_of_their_size(
    shape: tuple[int, int], labels: int, rng: np.random.Generator
) -> None:
    picture = rng.integers(0, 256, shape, np.uint8)
    found = matched(picture, picture, labels=labels)
    assert found.disparity_px.shape == shape
    assert found.disparity_px.dtype == np.float32
    values = found.disparity_px[found.valid]
    assert np.all((values >= 0) & (values <= labels - 1))


def test_more_labels_than_columns_find_what_there_is(rng: np.random.Generator) -> None:
    picture = noise(rng, 60, 120)
    found = matched(grey(picture), grey(np.roll(picture, -11, axis=1)), labels=512)
    assert np.nanmedian(found.disparity_px) == pytest.approx(11, abs=0.05)


@pytest.mark.parametrize("labels", [1, 5, 20, 30])
def test_only_labels_that_are_asked_for_are_found(labels: int, rng: np.random.Generator) -> None:
    picture = noise(rng, 80, 160)
    found = matched(grey(picture), grey(np.roll(picture, -12, axis=1)), labels=labels)
    assert found.window.labels == labels
    if labels > 13:
        assert np.nanmedian(found.disparity_px) == pytest.approx(12, abs=0.05)
    else:
        assert found.density < 0.1
    assert np.all(found.disparity_px[found.valid] <= labels - 1)


@pytest.mark.parametrize("labels", [16, 48, 128])
def test_the_last_label_but_one_is_found_as_well_as_the_first(labels: int, rng: np.random.Generator) -> None:
    picture = noise(rng, 60, 260)
    for shift_px in (1.0, labels - 2.0):
        found = matched(grey(picture), grey(np.roll(picture, -int(shift_px), axis=1)), labels=labels).disparity_px
        assert np.nanmedian(found) == pytest.approx(shift_px, abs=0.02)
        assert np.isfinite(found[:, labels + 5 : -5]).mean() > 0.9


@pytest.mark.parametrize("labels", [0, -16, 1025, 10**9])
def test_an_impossible_number_of_labels_is_refused(labels: int) -> None:
    picture = np.zeros((20, 20), np.uint8)
    with pytest.raises(UsageError, match=f"--max-disparity {labels}: search between 1 and 1024 disparities"):
        matched(picture, picture, labels=labels)


def test_pictures_of_two_sizes_are_refused() -> None:
    with pytest.raises(
        ImageError, match="the left picture is 30x20 and the right one 31x20: a rectified pair has one size"
    ):
        matched(np.zeros((20, 30), np.uint8), np.zeros((20, 31), np.uint8))


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((20, 20, 3), np.uint8), np.zeros((20, 20), np.uint16), np.zeros((20, 20), np.float32),
        np.zeros((0, 20), np.uint8), np.zeros(20, np.uint8), np.zeros((1, 20_000), np.uint8),
    ],
)  # fmt: skip
def test_what_is_no_grey_picture_is_refused(picture: np.ndarray) -> None:
    good = np.zeros((20, 20), np.uint8)
    for left, right in ((picture, picture), (good, picture), (picture, good)):
        with pytest.raises(
            ImageError, match=r"a matcher takes 8-bit grey pictures of at most 16384 pixels a side, not"
        ):
            matched(left, right)


@pytest.mark.parametrize("mask", [np.ones((20, 21), bool), np.ones((20, 20), np.uint8), np.ones(20, bool)])
def test_a_mask_that_does_not_fit_is_refused(mask: np.ndarray) -> None:
    picture = np.zeros((20, 20), np.uint8)
    for side in ("left_seen", "right_seen"):
        with pytest.raises(ImageError, match=r"a mask is .*, but the pictures are \(20, 20\): give bool, same size"):
            matched(picture, picture, **{side: mask})


def test_pictures_need_not_lie_straight_in_memory(rng: np.random.Generator) -> None:
    picture = noise(rng, 80, 160)
    left, right = grey(picture), grey(np.roll(picture, -6, axis=1))
    straight = matched(left, right).disparity_px
    np.testing.assert_array_equal(
        matched(np.asfortranarray(left), np.repeat(right, 2, axis=1)[:, ::2]).disparity_px, straight
    )


def test_the_same_pair_gives_the_same_map(rng: np.random.Generator) -> None:
    picture = noise(rng, 120, 200)
    left, right = grey(picture), grey(np.roll(picture, -6, axis=1))
    np.testing.assert_array_equal(matched(left, right).disparity_px, matched(left, right).disparity_px)


# ---- names, and matchers of one's own


def test_matchers_are_made_by_name() -> None:
    assert DEFAULT in MATCHERS
    assert all(isinstance(create(name), Matcher) for name in MATCHERS)
    with pytest.raises(UsageError, match=f"there is no matcher 'magic': choose one of {', '.join(MATCHERS)}"):
        create("magic")


class _Liar(Matcher):
    """Claims disparity 7 everywhere."""

    def search(self, left: np.ndarray, right: np.ndarray, search: Search) -> Found:
        return Found(np.full(left.shape, 7.0, np.float32))


def test_whatever_a_matcher_claims_partners_outside_the_picture_are_dropped() -> None:
    picture = np.zeros((5, 12), np.uint8)
    found = _Liar().match(RectifiedPair(picture, picture, DisparityWindow(16)))
    assert np.isnan(found.disparity_px[:, :7]).all()
    np.testing.assert_array_equal(found.disparity_px[:, 7:], 7.0)


# ---- real pictures with known truth


@pytest.mark.parametrize(
    ("name", "left", "right", "truth", "scale", "labels", "bad_percent"),
    [  # bad: share of matched pixels more than 2 px off, as the data's own README measured OpenCV's SGBM
        ("teddy", "im2.png", "im6.png", "disp2.png", 4, 64, 6.7),
        ("tsukuba", "im3.png", "im4.png", "disp3.pgm", 16, 16, 3.8),
        ("moebius_third", "view1.png", "view5.png", "disp1.png", 3, 80, 7.8),
    ],
)
def test_real_pairs_are_matched_as_well_as_their_source_says(
    data: Path, name: str, left: str, right: str, truth: str, scale: int, labels: int, bad_percent: float
) -> None:
    folder = data / "gt-middlebury" / name
    if not folder.is_dir():
        pytest.skip(f"real data: {folder} is not there")
    pictures = [cv2.imread(str(folder / file), cv2.IMREAD_GRAYSCALE) for file in (left, right, truth)]
    found = matched(pictures[0], pictures[1], labels=labels)
    judged = found.valid & (pictures[2] > 0)
    bad = np.abs(found.disparity_px - pictures[2] / scale)[judged] > 2
    assert 100 * bad.mean() <= bad_percent + 0.3
    assert found.density > 0.8
