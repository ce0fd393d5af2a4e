"""Assembly quality: poses whose flaw is known, and the rigs as their files promise them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.traced_boards import tipped
from prismstereo_calibration.judging.assembly import assembly
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.poses import rotations
from prismstereo_hw.rig import Rig

Array = NDArray[np.float64]
X, Y, Z = np.eye(3)


def turned(axis: Array, angle_deg: float) -> Array:
    return rotations(math.radians(angle_deg) * axis)


def posed(calibration: Calibration, R: Array, t: Array) -> Calibration:
    return replace(calibration, right=replace(calibration.right, R_camera_from_left=R, t_camera_from_left=t))


@pytest.fixture
def ideal(dslr: Rig) -> Calibration:
    return Calibration.nominal(dslr)


@pytest.mark.parametrize("name", ["dslr-35mm", "oak-1", "two-mirrors", "four-mirrors", "wedge"])
def test_a_rig_as_drawn_moves_in_the_plane_and_is_symmetric(name: str) -> None:
    built = assembly(Calibration.nominal(Rig.read(name)))
    assert built.axis_off_columns_deg == pytest.approx(0, abs=1e-6)
    assert built.shift_along_axis == pytest.approx(0, abs=1e-6)
    assert (built.pitch_deg, built.roll_deg) == pytest.approx((0, 0), abs=1e-6)
    assert built.asymmetry_deg == pytest.approx(0, abs=1e-5)


def test_the_views_of_a_prism_turn_by_four_times_what_the_mirrors_are_off_sixty_degrees(dslr: Rig) -> None:
    """Each view is turned by 2 (60 - angle), to either side (optics, pose structure)."""
    built = assembly(Calibration.nominal(dslr))
    assert built.turn_deg == pytest.approx(4 * (60 - 56.6), abs=1e-9)


@pytest.mark.parametrize("name", ["single-mirror", "three-mirrors"])
def test_parallel_views_have_a_turn_and_no_axis(name: str) -> None:
    built = assembly(Calibration.nominal(Rig.read(name)))
    assert built.turn_deg < 1e-6
    assert built.axis_off_columns_deg is built.shift_along_axis is built.shift_share is None


def test_a_shift_along_the_axis_is_measured_in_its_unit(ideal: Calibration) -> None:
    t = ideal.right.t_camera_from_left + 0.5 * Y
    built = assembly(posed(ideal, ideal.right.R_camera_from_left, t))
    assert built.shift_along_axis == pytest.approx(0.5)
    assert built.shift_share == pytest.approx(0.5 / float(np.linalg.norm(t)))
    assert built.axis_off_columns_deg == pytest.approx(0, abs=1e-9)


def test_a_camera_that_stands_rolled_behind_a_good_rig_turns_the_axis_and_nothing_else(ideal: Calibration) -> None:
    C = turned(Z, 2.0)
    built = assembly(posed(ideal, C @ ideal.right.R_camera_from_left @ C.T, C @ ideal.right.t_camera_from_left))
    assert built.axis_off_columns_deg == pytest.approx(2.0)
    assert built.shift_along_axis == pytest.approx(0, abs=1e-9)
    assert built.roll_deg == pytest.approx(0, abs=1e-9)
    assert built.pitch_deg == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("pitch_deg", [0.4, -0.4])
def test_a_right_view_that_looks_farther_up_has_that_pitch(ideal: Calibration, pitch_deg: float) -> None:
    up = turned(X, -pitch_deg)  # y is down: what was ahead now stands lower in the picture
    built = assembly(posed(ideal, up @ ideal.right.R_camera_from_left, up @ ideal.right.t_camera_from_left))
    above = posed(ideal, up @ ideal.right.R_camera_from_left, up @ ideal.right.t_camera_from_left).right
    assert (above.R_camera_from_left[2, 1] < 0) == (pitch_deg > 0)  # its axis points to negative y
    assert built.pitch_deg == pytest.approx(pitch_deg, abs=0.01)
    assert abs(built.roll_deg) < 0.1
    assert built.axis_off_columns_deg is not None
    assert built.axis_off_columns_deg > 0.5


@pytest.mark.parametrize("yaw_deg", [1.0, -0.5])
def test_a_right_mirror_at_another_angle_is_an_asymmetry(ideal: Calibration, yaw_deg: float) -> None:
    outwards = turned(Y, -yaw_deg)
    built = assembly(posed(ideal, outwards @ ideal.right.R_camera_from_left, outwards @ ideal.right.t_camera_from_left))
    assert built.asymmetry_deg == pytest.approx(yaw_deg, abs=1e-9)
    assert built.axis_off_columns_deg == pytest.approx(0, abs=1e-9)  # still a planar motion


def test_a_tipped_mirror_shows_as_pitch_and_a_turned_axis(oak: Rig) -> None:
    """A mirror tipped by 0.3 degrees turns its view by 0.6, of which sin 60 is pitch."""
    built = assembly(Calibration.nominal(tipped(oak, 0.3)))
    assert abs(built.pitch_deg) == pytest.approx(0.6 * math.sin(math.radians(60)), abs=0.15)
    assert built.axis_off_columns_deg is not None
    assert built.axis_off_columns_deg > 0.3
    assert assembly(Calibration.nominal(tipped(oak, -0.3))).pitch_deg == pytest.approx(-built.pitch_deg, rel=0.02)
