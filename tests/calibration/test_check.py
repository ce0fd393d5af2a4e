"""Checking a calibrated unit: what crept, what was moved, and what cannot be told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.crept_units import Unit, exact_calibration
from calibration.traced_boards import SQUARE_MM, flawed, tipped, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.upkeep.check import Check, State, check
from prismstereo_calibration.upkeep.focus import BoardFindings, board_findings
from prismstereo_calibration.upkeep.mount import mount_of
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig

BOARD = Board(9, 7, SQUARE_MM)


def checked(calibration: Calibration, unit: Unit, seed: int = 4, **more: BoardFindings | State) -> Check:
    scenes = unit.scenes(np.random.default_rng(seed), 4, 300)
    return check(calibration, scenes, mount_of(calibration, unit.rig), **more)  # type: ignore[arg-type]  # by name


def value(found: Check, name: str) -> float:
    return next(finding.value for finding in found.findings if finding.name.startswith(name))


def longer(camera: Camera, factor: float) -> Camera:
    lens = replace(camera.lens, fx_px=camera.lens.fx_px * factor, fy_px=camera.lens.fy_px * factor)
    return replace(camera, lens=lens)


class TestWithoutABoard:
    def test_a_unit_that_stands_as_it_was_is_fine(self, dslr: Rig) -> None:
        found = checked(exact_calibration(dslr), Unit.drawn(dslr))

        assert found.advice == "fine"
        assert found.cause == ""
        assert 0.01 < found.depth_sigma < 0.08  # rows tell little of depth, and must say so
        assert value(found, "vertical disparity, median") < 0.05
        assert value(found, "vertical disparity, 95 %") == pytest.approx(0.57, abs=0.05)  # 0.2 px in each view

    def test_a_tipped_mirror_asks_for_refinement(self, dslr: Rig) -> None:
        found = checked(exact_calibration(dslr), Unit.drawn(dslr).crept("right", "tip"))

        assert found.advice == "refine"
        assert value(found, "vertical disparity, median") > 1.5
        assert "a mirror has tipped" in found.cause

    def test_a_mirror_that_turned_far_shows_in_the_depth_that_the_rows_imply(self, dslr: Rig) -> None:
        unit = Unit.drawn(dslr).crept("left", "turn", 0.15)
        calibration = exact_calibration(dslr)

        found = checked(calibration, unit)

        assert found.advice == "refine"
        assert 5.0 < value(found, "depth error at 1000 mm") < 1000 * abs(unit.bias(calibration))
        assert "a mirror has turned" in found.cause

    def test_another_lens_is_no_creep(self, dslr: Rig) -> None:
        unit = Unit.drawn(flawed(dslr, (0.0, 0.0), (-0.25, 0.0)))

        found = checked(exact_calibration(dslr), unit)

        assert found.advice == "recalibrate"
        assert "another lens" in found.cause

    def test_a_pattern_in_the_rows_that_no_pose_explains_asks_for_a_new_calibration(self, dslr: Rig) -> None:
        calibration = exact_calibration(dslr)
        scenes = Unit.drawn(dslr).scenes(np.random.default_rng(4), 4, 300)
        waves = [replace(one, right_px=one.right_px + np.cos(one.left_px[:, 1:] / 115) * [0, 1]) for one in scenes]

        found = check(calibration, waves, mount_of(calibration, dslr))

        assert found.advice == "recalibrate"
        assert value(found, "vertical disparity no pose") > 0.3

    def test_scenes_without_texture_tell_nothing(self, dslr: Rig) -> None:
        scenes = [scene.only(np.arange(50) < 3) for scene in Unit.drawn(dslr).scenes(np.random.default_rng(1), 2, 50)]

        with pytest.raises(CalibrationError, match=r"0 of 2 scenes show 40 points"):
            check(exact_calibration(dslr), scenes, mount_of(exact_calibration(dslr), dslr))

    def test_another_lens_position_and_another_season_are_told(self, dslr: Rig) -> None:
        calibration = replace(exact_calibration(dslr), lens_position=120, temperature_c=20.0)
        unit = Unit.drawn(dslr)

        assert checked(calibration, unit, state=State(120, 26.0)).advice == "fine"
        assert checked(calibration, unit, state=State(120, 35.0)).advice == "refine"
        moved = checked(calibration, unit, state=State(131, 20.0))
        assert moved.advice == "recalibrate"
        assert "another position" in moved.cause


class TestWithABoard:
    def seen(self, calibration: Calibration, rig: Rig, seed: int = 3) -> BoardFindings:
        sightings = traced_detection(rig, seed, poses=4).sightings
        return board_findings(calibration, sightings, BOARD, mount_of(calibration, rig))

    def test_a_good_unit_has_the_right_scale_and_focus(self, dslr: Rig) -> None:
        calibration = exact_calibration(dslr)

        board = self.seen(calibration, dslr)

        assert board.rms_px == pytest.approx(0.28, abs=0.03)
        assert abs(board.scale_error) < max(0.001, 3 * board.scale_sigma)
        assert abs(board.focal_change) < max(3 * board.focal_sigma, 0.001)
        assert checked(calibration, Unit.drawn(dslr), board=board).advice == "fine"

    @pytest.mark.parametrize("change", [0.006, -0.004])
    def test_a_moved_focus_ring_is_named_with_its_amount(self, dslr: Rig, change: float) -> None:
        true = exact_calibration(dslr)
        before = replace(true, left=longer(true.left, 1 / (1 + change)), right=longer(true.right, 1 / (1 + change)))

        board = self.seen(before, dslr)
        found = checked(before, Unit.drawn(dslr), board=board)

        assert board.focal_change == pytest.approx(change, abs=max(3 * board.focal_sigma, 0.0005))
        assert found.advice == "recalibrate"
        assert f"focal length changed by {100 * board.focal_change:+.2f} %" in found.cause

    def test_a_tipped_mirror_is_not_taken_for_the_focus(self, dslr: Rig) -> None:
        calibration = exact_calibration(dslr)

        board = self.seen(calibration, tipped(dslr, 0.05))
        found = checked(calibration, Unit.drawn(tipped(dslr, 0.05)), board=board)

        assert board.rms_mount_px < 0.5 * board.rms_px
        assert found.advice == "refine"
        assert "mirror" in found.cause

    def test_lengths_in_another_unit_and_too_few_corners_are_refused(self, dslr: Rig) -> None:
        calibration = exact_calibration(dslr)
        sightings = traced_detection(dslr, 3, poses=4).sightings

        with pytest.raises(UsageError, match="--square-mm"):
            board_findings(calibration, sightings, Board(9, 7), mount_of(calibration, dslr))
        with pytest.raises(CalibrationError, match="no frame shows"):
            board_findings(calibration, (), BOARD, mount_of(calibration, dslr))
