from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from prismstereo.held_calibration import HeldCalibration
from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.protocol import ReceivedFrame, calibration_hash
from prismstereo_hw.errors import DataError
from prismstereo_hw.rig import RangeWish, Rig

WINDOW = DisparityWindow(32, -1.0, 5000.0)


class OneObject:
    """What is read of a camera: its calibration, and how often."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.reads = 0

    def read(self, obj: int, most: int) -> bytes:
        self.reads += 1
        return self.content


@pytest.fixture(scope="module")
def calibration(small: Rig) -> Calibration:
    return Calibration.nominal(small)


def frame_of(window: DisparityWindow, content: bytes, shape: tuple[int, int]) -> ReceivedFrame:
    """A frame as it comes off the wire: its window in 32-bit floats and without glass, its calibration by 4 bytes."""
    steps = np.random.default_rng(8).integers(0, 16 * (window.labels - 2), shape, dtype=np.uint16)
    wired = DisparityWindow(window.labels, float(np.float32(window.offset_px)), float(np.float32(window.scale_px)))
    return ReceivedFrame(1, 1000, DisparityMap.from_fixed_point(steps, wired), calibration_hash(content)[:4], None, 0)


def sized(made: Rectification) -> tuple[int, int]:
    return made.height, made.width


@pytest.mark.parametrize(
    "wish", [None, RangeWish(near_mm=700.0, far_mm=4000.0, labels=64)], ids=["own range", "wished"]
)
def test_depth_is_made_with_the_frames_own_window_and_the_glass_of_its_calibration(
    calibration: Calibration, wish: RangeWish | None
) -> None:
    content = flash.pack(calibration)
    held = HeldCalibration(OneObject(content), "the line")
    made = rectification(flash.unpack(content)) if wish is None else rectification(flash.unpack(content), wish, 64)
    frame = frame_of(made.window, content, sized(made))
    disparity_px = frame.disparity.disparity_px
    depth = held.window(frame).depth_map(disparity_px)
    true = made.window.depth_map(disparity_px)
    near = true < 10_000
    np.testing.assert_allclose(depth[near], true[near], rtol=2e-5)
    without = made.window.depth(disparity_px)
    assert np.nanmax(np.abs(without[near] / true[near] - 1)) > 1e-4  # the glass is worth it


def test_a_frame_of_half_the_resolution_has_the_depth_of_its_own_window(calibration: Calibration) -> None:
    content = flash.pack(calibration)
    held = HeldCalibration(OneObject(content), "the line")
    full = rectification(flash.unpack(content))
    half = DisparityWindow(full.window.labels // 2 + 1, full.window.offset_px / 2, full.window.scale_px / 2)
    frame = frame_of(half, content, (full.height // 2, full.width // 2))
    depth = held.window(frame).depth_map(frame.disparity.disparity_px)
    np.testing.assert_array_equal(depth, frame.disparity.depth())
    at_20_px = half.depth(np.float32(20.0))
    assert at_20_px == pytest.approx(full.window.depth(np.float32(40.0)), rel=1e-6)


def test_a_calibration_is_fetched_once_and_again_when_frames_are_of_another(calibration: Calibration) -> None:
    first, second = flash.pack(calibration), flash.pack(replace(calibration, rig="another"))
    camera = OneObject(first)
    held = HeldCalibration(camera, "the line")
    window, shape = WINDOW, (4, 4)
    for _ in range(3):
        held.window(frame_of(window, first, shape))
    assert camera.reads == 1
    camera.content = second
    held.window(frame_of(window, second, shape))
    assert (camera.reads, held.calibration(calibration_hash(second)).rig) == (2, "another")


def test_a_frame_of_a_calibration_that_is_gone_is_an_error_and_not_made_with_another(calibration: Calibration) -> None:
    first, second = flash.pack(calibration), flash.pack(replace(calibration, rig="another"))
    held = HeldCalibration(OneObject(second), "the line")
    with pytest.raises(
        DataError, match=f"has hash {calibration_hash(second).hex()}, asked for was .*: it was replaced"
    ):
        held.window(frame_of(WINDOW, first, (4, 4)))


def test_a_frame_without_a_calibration_has_the_depth_that_its_window_says() -> None:
    camera = OneObject(b"")
    held = HeldCalibration(camera, "the line")
    frame = frame_of(DisparityWindow(64, 0.0, 5000.0), b"", (2, 2))
    assert held.window(frame) == DisparityWindow(64, 0.0, 5000.0)
    assert camera.reads == 0
    with pytest.raises(DataError, match="holds no calibration"):
        held.content(bytes(8))
