"""Rectify: the maps show each rectified pixel what the optics put there, and say where there is nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_device.rectify import Rectifier
from prismstereo_device.split import StereoPair, split
from prismstereo_hw.errors import ImageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig


@pytest.fixture(scope="module")
def oak_maps(oak: Rig) -> Rectifier:
    return Rectifier(rectification(Calibration.nominal(oak)))


def pair_of(left: np.ndarray, right: np.ndarray) -> StereoPair:
    return StereoPair(left, right, 0, 0)


def test_every_rectified_pixel_shows_its_source(oak_maps: Rectifier) -> None:
    # pictures whose grey level is the column, then the row: what is read back is the source pixel itself
    rows, columns = np.mgrid[:720, :640]
    made = oak_maps.rectification
    for grey, axis in ((columns // 3, 0), (rows // 3, 1)):
        picture = grey.astype(np.uint8)
        pair = oak_maps.rectify(pair_of(picture, picture))
        for shown, seen, side in ((pair.left, pair.left_seen, made.left), (pair.right, pair.right_seen, made.right)):
            source = made.sources(side)[..., axis]
            assert seen is not None
            off = shown[seen].astype(float) - (source[seen] - 1) / 3
            assert np.abs(off).max() < 1.01  # grey levels are whole, and a third of a pixel


def test_where_a_view_shows_nothing_it_is_black_and_not_seen(oak_maps: Rectifier) -> None:
    white, made = np.full((720, 640), 255, np.uint8), oak_maps.rectification
    pair = oak_maps.rectify(pair_of(white, white))
    for shown, seen, side in ((pair.left, pair.left_seen, made.left), (pair.right, pair.right_seen, made.right)):
        assert seen is not None
        there = np.isfinite(made.sources(side)[..., 0])
        assert shown[there].min() == 255
        assert shown[~there].max() == 0
        assert 0.7 < seen.mean() < there.mean() < 1


def test_windows_at_the_rim_of_a_view_would_reach_over_it_so_the_rim_is_not_seen(oak_maps: Rectifier) -> None:
    there = np.isfinite(oak_maps.rectification.sources(oak_maps.rectification.left)[..., 0])
    blank = np.zeros((720, 640), np.uint8)
    seen = oak_maps.rectify(pair_of(blank, blank)).left_seen
    assert seen is not None
    assert not seen[~there].any()
    for row in (200, 360, 520):
        for inward, mask in ((there[row], seen[row]), (there[row, ::-1], seen[row, ::-1])):
            first = int(np.argmax(inward))
            assert int(np.argmax(mask)) == (first + 3 if first else 0)  # the picture's own border is no rim


def test_both_pictures_of_a_plane_agree_row_by_row(
    rig: Rig, rectified: Rectification, plane_frame: Callable[[float], RawFrame]
) -> None:
    pair = Rectifier(rectified).rectify(split(plane_frame(1000.0), rig.views))
    disparity = round(rectified.window.scale_px / 1013.0 - rectified.window.offset_px)
    left, right = pair.left[:, 300:500].astype(float), pair.right[:, 300 - disparity : 500 - disparity].astype(float)

    def alike(up: int) -> float:
        return float(np.corrcoef(left[100:600].ravel(), right[100 + up : 600 + up].ravel())[0, 1])

    assert alike(0) > 0.9
    assert alike(0) > max(alike(-1), alike(1)) + 0.02


def test_the_window_goes_with_the_pair(rectified: Rectification, rig: Rig) -> None:
    blank = np.zeros((720, 640), np.uint8)
    assert Rectifier(rectified).rectify(pair_of(blank, blank)).window == rectified.window


def test_colours_are_matched_in_grey_and_kept_for_the_picture(oak_maps: Rectifier) -> None:
    colour = np.zeros((720, 640, 3), np.uint8)
    colour[...] = (10, 100, 200)  # BGR
    pair = oak_maps.rectify(pair_of(colour, colour))
    assert pair.left.shape == (720, 640)
    assert pair.left.max() == round(0.114 * 10 + 0.587 * 100 + 0.299 * 200)
    picture = oak_maps.left_picture(pair_of(colour, colour))
    np.testing.assert_array_equal(picture[360, 320], (10, 100, 200))


def test_mirrored_views_need_not_lie_straight_in_memory(oak_maps: Rectifier, rng: np.random.Generator) -> None:
    picture = rng.integers(0, 256, (720, 640), np.uint8)
    straight = oak_maps.rectify(pair_of(picture, picture))
    backward = oak_maps.rectify(pair_of(picture[:, ::-1].copy()[:, ::-1], np.asfortranarray(picture)))
    np.testing.assert_array_equal(straight.left, backward.left)
    np.testing.assert_array_equal(straight.right, backward.right)


@pytest.mark.parametrize("shapes", [((720, 641), (720, 640)), ((720, 640), (719, 640)), ((640, 720), (640, 720))])
def test_views_of_another_size_are_refused_with_their_side(
    oak_maps: Rectifier, shapes: tuple[tuple[int, int], tuple[int, int]]
) -> None:
    pair = pair_of(*(np.zeros(shape, np.uint8) for shape in shapes))
    side = "left" if shapes[0] != (720, 640) else "right"
    with pytest.raises(ImageError, match=rf"the {side} view is \d+x\d+, but this rectification is for 640x720"):
        oak_maps.rectify(pair)
    with pytest.raises(ImageError, match="but this rectification is for 640x720"):
        oak_maps.left_picture(pair)
