"""Every unmatched pixel has its reason, from pictures in which the reason is known."""

from __future__ import annotations

import numpy as np
import pytest

from device.shifted_noise import grey, noise
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters import explained
from prismstereo_device.reasons import Reason
from prismstereo_hw.errors import ImageError

SHAPE = (160, 320)
WHOLE = np.s_[:, :]
MIDDLE = np.s_[40:120, 160:280]
INNER = np.s_[46:114, 166:274]  # a window's reach from the border of the middle


def nothing_matched(labels: int = 64, **more: object) -> DisparityMap:
    return DisparityMap(np.full(SHAPE, np.nan, np.float32), DisparityWindow(labels), **more)  # type: ignore[arg-type]


def pair_with(rng: np.random.Generator, disparity_px: int, place: tuple[slice, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Two pictures of a background at 8 px, with an object at another disparity in one place of the left one."""
    background, thing = noise(rng, *SHAPE), noise(rng, *SHAPE)
    left, right = background.copy(), np.roll(background, -8, axis=1)
    left[place] = thing[place]
    rows, columns = place
    right[rows, columns.start - disparity_px : columns.stop - disparity_px] = thing[place]
    return grey(left), grey(right)


@pytest.mark.parametrize(
    ("level", "sigma", "reason"),
    [(255, 0, Reason.SATURATED), (2, 1, Reason.DARK), (120, 0, Reason.WEAK_TEXTURE), (120, 2, Reason.WEAK_TEXTURE)],
)
def test_the_picture_says_what_it_lacks(level: int, sigma: float, reason: Reason, rng: np.random.Generator) -> None:
    left = noise(rng, *SHAPE)
    left[MIDDLE] = level + rng.normal(0, sigma, left[MIDDLE].shape)
    left, right = grey(left), grey(np.roll(left, -8, axis=1))
    found = explained(nothing_matched(), left, right).reasons
    assert found is not None
    assert (found[INNER] == reason).mean() > 0.99
    outer = np.ones(SHAPE, bool)
    outer[30:130, 150:290] = False
    assert (found[outer] == Reason.UNMATCHED).mean() > 0.97  # there is texture, and nothing is known against it


def test_what_the_calibration_knows_comes_before_what_the_picture_shows(rng: np.random.Generator) -> None:
    left = np.zeros(SHAPE, np.uint8)
    static = np.zeros(SHAPE, np.uint8)
    static[:, :20], static[:, 20:40] = Reason.SEAM, Reason.VIGNETTED
    seen = np.ones(SHAPE, bool)
    seen[:, 30:60] = False
    found = explained(nothing_matched(), left, left, seen, static).reasons
    assert found is not None
    for columns, reason in (
        (np.s_[:20], 2),
        (np.s_[20:40], 3),
        (np.s_[40:60], Reason.OUTSIDE),
        (np.s_[60:], Reason.DARK),
    ):
        assert (found[:, columns] == reason).all()


def test_what_a_filter_or_the_matcher_said_is_kept(rng: np.random.Generator) -> None:
    background = noise(rng, *SHAPE)
    said = np.full(SHAPE, Reason.OCCLUDED, np.uint8)
    said[:40], said[40:80], said[80:120] = Reason.FILTERED, Reason.AMBIGUOUS, Reason.TOO_FAR
    pair = grey(background), grey(np.roll(background, -8, axis=1))
    np.testing.assert_array_equal(explained(nothing_matched(reasons=said), *pair).reasons, said)
    black = np.zeros(SHAPE, np.uint8)
    found = explained(nothing_matched(reasons=said), black, black).reasons
    assert found is not None
    assert (found[:40] == Reason.FILTERED).all()  # known, whatever the picture is like
    assert (found[40:80] == Reason.DARK).all()  # a guess of the matcher's: the picture is why


def test_an_object_nearer_than_the_search_reaches_is_too_near(rng: np.random.Generator) -> None:
    left, right = pair_with(rng, 100, (MIDDLE[0], MIDDLE[1]))
    inside = explained(nothing_matched(labels=128), left, right).reasons
    beyond = explained(nothing_matched(labels=64), left, right).reasons
    assert inside is not None
    assert beyond is not None
    assert (inside == Reason.TOO_NEAR).mean() < 0.005
    assert (beyond[INNER] == Reason.TOO_NEAR).mean() > 0.9
    assert (beyond[:, :120] == Reason.TOO_NEAR).mean() < 0.02


def test_a_window_with_a_far_end_knows_what_lies_beyond_it(rng: np.random.Generator) -> None:
    left, right = pair_with(rng, -12, (MIDDLE[0], MIDDLE[1]))
    for offset_px, told in ((30.0, True), (-1.0, False)):  # ends at 31 px of parallax, or at infinity
        window = DisparityWindow(64, offset_px, 50_000.0)
        found = explained(DisparityMap(np.full(SHAPE, np.nan, np.float32), window), left, right).reasons
        assert found is not None
        assert ((found[INNER] == Reason.TOO_FAR).mean() > 0.9) == told


def test_matched_pixels_have_no_reason_and_keep_all_else(rng: np.random.Generator) -> None:
    picture = grey(noise(rng, *SHAPE))
    disparity = rng.uniform(1, 60, SHAPE).astype(np.float32)
    disparity[MIDDLE] = np.nan
    confidence = np.full(SHAPE, 9, np.uint8)
    given = DisparityMap(disparity, DisparityWindow(64), confidence)
    found = explained(given, picture, picture)
    assert found.reasons is not None
    np.testing.assert_array_equal(found.reasons == Reason.MATCHED, ~np.isnan(disparity))
    assert found.disparity_px is disparity
    assert found.confidence is confidence


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (2, 2), (9, 9), (50, 37)])
def test_the_smallest_pictures_are_explained(shape: tuple[int, int], rng: np.random.Generator) -> None:
    picture = rng.integers(0, 256, shape, np.uint8)
    given = DisparityMap(np.full(shape, np.nan, np.float32), DisparityWindow(1024))
    found = explained(given, picture, picture).reasons
    assert found is not None
    assert found.shape == shape
    assert (found != Reason.MATCHED).all()


def test_pictures_and_masks_of_another_size_are_refused() -> None:
    good, wide = np.zeros(SHAPE, np.uint8), np.zeros((160, 321), np.uint8)
    for given in ((wide, good), (good, wide), (good, good, wide > 0), (good, good, good), (good, good, None, wide)):
        with pytest.raises(ImageError, match=r"but the disparity map \(160, 320\): give"):
            explained(nothing_matched(), *given)
