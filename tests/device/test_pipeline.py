"""The camera's work on one frame, from raw pixels to disparity."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_device.match.base import Found, Matcher, Search
from prismstereo_device.match.opencv import SgbmMatcher
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.errors import UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin


def test_a_raw_frame_becomes_metric_depth(
    rig: Rig, nominal: Calibration, pinhole_z_mm: float, plane_frame: Callable[[float], RawFrame]
) -> None:
    found = Pipeline(nominal).process(plane_frame(1000.0))
    assert found.density > 0.6
    assert np.nanmedian(found.depth()) == pytest.approx(1000.0 - pinhole_z_mm, rel=0.003)


def test_the_steps_one_by_one_are_the_whole(oak: Rig) -> None:
    frame = Twin(oak, facing_plane(oak, 700.0)).frame()
    pipeline = Pipeline(Calibration.nominal(oak), SgbmMatcher())
    by_hand = SgbmMatcher().match(pipeline.rectifier.rectify(pipeline.split(frame)))
    np.testing.assert_array_equal(pipeline.process(frame).disparity_px, by_hand.disparity_px)


def test_a_wished_range_gives_finer_steps_where_it_is_wanted(
    rig: Rig, nominal: Calibration, pinhole_z_mm: float, plane_frame: Callable[[float], RawFrame]
) -> None:
    pipeline = Pipeline(nominal, wish=RangeWish(near_mm=800, far_mm=1300, labels=16))
    found = pipeline.process(plane_frame(1000.0))
    assert found.window.labels < rig.range.labels
    assert found.window.farthest == pytest.approx(1300)
    assert np.nanmedian(found.depth()) == pytest.approx(1000.0 - pinhole_z_mm, rel=0.003)
    assert found.density > 0.6


def test_labels_alone_are_granted_or_refused(oak: Rig) -> None:
    calibration = Calibration.nominal(oak)
    assert Pipeline(calibration, labels=256).rectifier.rectification.window.labels == 256
    with pytest.raises(UsageError, match="but 32 are searched"):
        Pipeline(calibration, labels=32)
    with pytest.raises(UsageError, match="are searched"):
        Pipeline(calibration, wish=RangeWish(near_mm=20, far_mm=math.inf, labels=16))


def test_frames_that_do_not_belong_are_refused(oak: Rig) -> None:
    calibration = dataclasses.replace(Calibration.nominal(oak), lens_position=140)
    pipeline = Pipeline(calibration)
    for frame, words in (
        (RawFrame(np.zeros((480, 640), np.uint8), index=2), "frame 2 is 640x480, but the calibration of 'oak-1'"),
        (RawFrame(np.zeros((720, 1280), np.uint8), lens_position=141), "at lens position 141, but"),
    ):
        with pytest.raises(CalibrationError, match=words):
            pipeline.process(frame)


def test_colour_frames_are_processed_like_grey_ones(oak: Rig, rng: np.random.Generator) -> None:
    class Sum(Matcher):
        """Finds the grey levels themselves."""

        def search(self, left: np.ndarray, right: np.ndarray, search: Search) -> Found:
            return Found(left.astype(np.float32) / 255)

    grey = rng.integers(0, 256, (720, 1280), np.uint8)
    pipeline = Pipeline(Calibration.nominal(oak), Sum())
    one, other = (pipeline.process(RawFrame(pixels)) for pixels in (grey, np.stack([grey] * 3, axis=-1)))
    np.testing.assert_array_equal(one.disparity_px, other.disparity_px)
