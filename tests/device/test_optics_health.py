from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration
from prismstereo_device.optics_health import Finding, OpticsHealth, OpticsReport, OpticsWatcher, take_look
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.kinds.prism_tir import PrismRig
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import named
from prismstereo_hw.surroundings import Spot, Surroundings
from prismstereo_hw.twin import Twin

Pixels = NDArray[np.uint8]
Change = Callable[[Pixels], Pixels]

RIG = Rig.read("oak-1")
assert isinstance(RIG, PrismRig)
WIDTH = RIG.camera.video.width
SEEDS = (1, 2, 3, 4)
SIDES = ("left", "right")


def frames(rig: PrismRig = RIG, spots: Sequence[Spot] = ()) -> list[RawFrame]:
    """The same unit before four scenes."""
    around = Surroundings(spots=tuple(spots))
    return [Twin(rig, named(rig, "desk", seed), surroundings=around, seed=seed).frame(seed) for seed in SEEDS]


def half(side: str) -> slice:
    """Columns of a view in the raw frame."""
    view = RIG.views[SIDES.index(side)]
    return slice(int(view.left * WIDTH), int((view.left + view.width) * WIDTH))


class Unit:
    """A unit that was healthy when it was calibrated."""

    def __init__(self) -> None:
        self.pipeline = Pipeline(Calibration.nominal(RIG))
        self.frames = frames()
        self.reference: dict[str, float] | None = None
        self.report, self.reference = self.look(self.frames)

    def look(
        self, seen: list[RawFrame], change: Change = lambda pixels: pixels
    ) -> tuple[OpticsReport, dict[str, float]]:
        how = self.pipeline.rectifier.rectification
        health = OpticsHealth(how.width, how.height, WIDTH, self.reference)
        for frame in seen:
            frame = replace(frame, pixels=change(frame.pixels.copy()))
            pair = self.pipeline.split(frame)
            rectified = self.pipeline.rectifier.rectify(pair)
            health.add(take_look(frame.pixels, rectified), rectified, self.pipeline.disparity(pair))
        return health.report(), health.reference

    def warned(self, seen: list[RawFrame], change: Change = lambda pixels: pixels) -> dict[str, Finding]:
        report = self.look(seen, change)[0]
        return {finding.name: finding for finding in report.findings if finding.state == "warn"}


@pytest.fixture(scope="module")
def unit() -> Unit:
    return Unit()


def test_nothing_is_wrong_with_a_unit_as_it_was_calibrated(unit: Unit) -> None:
    assert unit.report.ok
    assert all(finding.state == "ok" for finding in unit.report.findings)
    assert abs(unit.report.finding("vertical_px").value) < 0.02
    assert unit.report.finding("seam_px").value == pytest.approx((WIDTH - 1) / 2, abs=0.1)


def test_dust_is_found_in_its_own_view_where_it_lies(unit: Unit) -> None:
    spots = [
        Spot(side, (half(side).start + half(side).stop) / 2, row, 28, dark=dark)
        for side, row, dark in (("left", 300.0, 0.3), ("right", 450.0, 0.2))
    ]
    report = unit.look(frames(spots=spots))[0]
    assert {finding.name for finding in report.findings if finding.state == "warn"} == {"dust_left", "dust_right"}
    assert "left view has dark spots" in report.finding("dust_left").mend
    for found, dark in zip(report.dust, (0.3, 0.2), strict=True):
        (spot,) = found
        assert 0.4 * dark < spot.dark < 1.1 * dark  # a cell is larger than the darkest middle
    assert report.dust[0][0].y_share == pytest.approx(300 / 720, abs=0.03)
    assert report.dust[1][0].y_share == pytest.approx(450 / 720, abs=0.03)


@pytest.mark.parametrize("side", SIDES)
def test_a_covered_half_is_named(unit: Unit, side: str) -> None:
    def cover(pixels: Pixels) -> Pixels:
        pixels[:, half(side)] //= 12
        return pixels

    warned = unit.warned(unit.frames, cover)
    assert f"covered_{side}" in warned
    assert f"covered_{'left' if side == 'right' else 'right'}" not in warned
    assert f"the {side} view shows next to nothing" in warned[f"covered_{side}"].mend


def test_a_view_that_became_darker_is_named(unit: Unit) -> None:
    def dim(pixels: Pixels) -> Pixels:
        pixels[:, half("right")] = (0.7 * pixels[:, half("right")]).astype(np.uint8)
        return pixels

    warned = unit.warned(unit.frames, dim)
    assert list(warned) == ["brightness_ratio"]
    assert warned["brightness_ratio"].value == pytest.approx(1 / 0.7, rel=0.02)
    assert "the right view has become darker" in warned["brightness_ratio"].mend


def test_a_view_that_became_blurred_is_named(unit: Unit) -> None:
    def blur(pixels: Pixels) -> Pixels:
        pixels[:, half("left")] = cv2.GaussianBlur(pixels[:, half("left")], (0, 0), 1.5)
        return pixels

    warned = unit.warned(unit.frames, blur)
    assert list(warned) == ["sharpness_ratio"]
    assert "the left view has become blurred" in warned["sharpness_ratio"].mend


def test_a_prism_that_moved_is_seen_by_its_seam(unit: Unit) -> None:
    warned = unit.warned(unit.frames, lambda pixels: np.roll(pixels, 8, axis=1))
    assert warned["seam_px"].value - warned["seam_px"].expected == pytest.approx(8, abs=0.2)
    assert "tighten its mount" in warned["seam_px"].mend


def test_a_mirror_that_tipped_by_a_tenth_of_a_degree_is_two_rows_of_vertical_disparity(unit: Unit) -> None:
    tipped = msgspec.structs.replace(RIG.mirrors, left_tip_deg=RIG.mirrors.left_tip_deg + 0.1)
    warned = unit.warned(frames(msgspec.structs.replace(RIG, mirrors=tipped)))
    assert warned["vertical_px"].value == pytest.approx(1.96, abs=0.1)
    assert "prismstereo refine" in warned["vertical_px"].mend


def test_a_blank_picture_tells_nothing_and_alarms_nobody(unit: Unit) -> None:
    report = unit.look(unit.frames, lambda pixels: np.full_like(pixels, 120))[0]
    assert report.finding("vertical_px").state == "unknown"
    assert report.finding("seam_px").state == "unknown"
    assert report.finding("covered_left").state != "warn"
    assert report.finding("vertical_px").as_json()["value"] is None


def test_a_report_is_plain_json_and_a_reference_comes_back_from_its_file(unit: Unit) -> None:
    assert msgspec.json.decode(msgspec.json.encode(unit.report.as_json()))["ok"] is True
    kept = msgspec.json.decode(msgspec.json.encode(unit.reference), type=dict[str, float])
    assert kept == unit.reference
    assert set(kept) == {"brightness_ratio", "sharpness_ratio", "grey_ratio", "texture_ratio", "seam_px"}


def test_looks_are_taken_apart_from_the_frames_and_on_demand(unit: Unit) -> None:
    how = unit.pipeline.rectifier.rectification
    pair = unit.pipeline.rectifier.rectify(unit.pipeline.split(unit.frames[0]))
    with OpticsWatcher(OpticsHealth(how.width, how.height, WIDTH), period_s=3600.0) as watcher:
        for looks in (1, 2, 3):
            assert watcher.due
            begin = time.monotonic()
            watcher.show(unit.frames[0].pixels, pair, None)
            assert time.monotonic() - begin < 0.1
            assert not watcher.due
            deadline = time.monotonic() + 10
            while watcher.report.looks < looks:
                assert time.monotonic() < deadline
                time.sleep(0.01)
            time.sleep(0.02)
            assert not watcher.due, "an hour has not passed"
            watcher.hurry()
        assert watcher.report.ok
        assert set(watcher.reference) == {
            "brightness_ratio",
            "sharpness_ratio",
            "grey_ratio",
            "texture_ratio",
            "seam_px",
        }
