"""Split: one raw frame into two upright views."""

from __future__ import annotations

import numpy as np
import pytest

from prismstereo_device.split import split
from prismstereo_hw.errors import ImageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import LAYOUTS, View


def test_a_prism_frame_is_split_crosswise(rig: Rig, rng: np.random.Generator) -> None:
    pixels = rng.integers(0, 256, (720, 1280), np.uint8)
    pair = split(RawFrame(pixels), rig.views)
    np.testing.assert_array_equal(pair.left, pixels[:, 640:])
    np.testing.assert_array_equal(pair.right, pixels[:, :640])


def test_the_exposure_goes_with_both_views(rng: np.random.Generator) -> None:
    frame = RawFrame(rng.integers(0, 256, (8, 8), np.uint8), index=7, timestamp_us=123_456, lens_position=99)
    pair = split(frame, LAYOUTS["side-by-side"])
    assert (pair.index, pair.timestamp_us, pair.lens_position) == (7, 123_456, 99)


def test_nothing_is_copied_that_need_not_be(rng: np.random.Generator) -> None:
    pixels = rng.integers(0, 256, (8, 8), np.uint8)
    for name in LAYOUTS:
        pair = split(RawFrame(pixels), LAYOUTS[name])
        assert np.shares_memory(pair.left, pixels)
        assert np.shares_memory(pair.right, pixels)


def test_colour_and_turned_views_come_out_upright() -> None:
    pixels = np.zeros((4, 8, 3), np.uint8)
    pixels[0, 4] = (1, 2, 3)  # top left of the right half
    turned = View(left=0.5, top=0.0, width=0.5, height=1.0, turn_deg=180)
    mirrored = View(left=0.5, top=0.0, width=0.5, height=1.0, mirrored=True)
    pair = split(RawFrame(pixels), (turned, mirrored))
    np.testing.assert_array_equal(pair.left[3, 3], (1, 2, 3))
    np.testing.assert_array_equal(pair.right[0, 3], (1, 2, 3))


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((4, 4), np.uint16), np.zeros((4, 4), float), np.zeros((4, 4, 4), np.uint8), np.zeros(4, np.uint8),
        np.zeros((0, 4), np.uint8), np.zeros((4, 4, 1), np.uint8), np.zeros((4, 4), bool),
    ],
)  # fmt: skip
def test_what_is_no_8_bit_picture_is_no_frame(pixels: np.ndarray) -> None:
    with pytest.raises(ImageError, match=r"frame 3 is .*: a raw frame is 8-bit grey or BGR, not empty"):
        RawFrame(pixels, index=3)
