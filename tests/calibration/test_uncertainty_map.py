"""Depth uncertainty, against closed forms of two parallel pinholes and against many draws of a real covariance."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.traced_boards import SQUARE_MM, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.judging.triangulation import meet
from prismstereo_calibration.judging.uncertainty_map import (
    baseline_sigma,
    depth_sigma,
    matching_sigma,
    scale_sigma,
    uncertainty_maps,
    yardstick,
)
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.poses import rotations
from prismstereo_calibration.solving.solve import solve
from prismstereo_calibration.uncertainty import NUMBERS, Uncertainty
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import layout

Array = NDArray[np.float64]
FOCAL_PX, BASELINE_MM = 1000.0, 50.0


def parallel(sigmas: dict[str, float], *, shared: tuple[str, ...] = (), unit: str = "mm") -> Calibration:
    """Two parallel pinholes side by side in a frame of 1280x720; the `shared` numbers move together."""
    covariance = np.diag([sigmas.get(name, 0.0) ** 2 for name in NUMBERS])
    for name in shared:
        a, b = NUMBERS.index(f"left_{name}"), NUMBERS.index(f"right_{name}")
        covariance[a, b] = covariance[b, a] = sigmas[f"left_{name}"] * sigmas[f"right_{name}"]
    left, right = layout("side-by-side")
    return Calibration(
        rig="parallel", frame_width=1280, frame_height=720, left_view=left, right_view=right,
        left=Camera.at_origin(Lens(FOCAL_PX, FOCAL_PX, 319.5, 359.5)),
        right=Camera(Lens(FOCAL_PX, FOCAL_PX, 959.5, 359.5), np.eye(3), np.array([-BASELINE_MM, 0.0, 0.0])),
        range=RangeWish(near_mm=400.0, far_mm=math.inf, labels=128), model="two-camera",
        unit="mm" if unit == "mm" else "square", uncertainty=Uncertainty(covariance),
    )  # fmt: skip


PIXELS = np.array([[319.5, 359.5], [420.0, 200.0], [600.0, 700.0]])


@pytest.mark.parametrize("depth_mm", [500.0, 1000.0, 2000.0])
def test_depth_is_as_uncertain_as_each_number_makes_it_alone(depth_mm: float) -> None:
    """Z = f B / d: shares of f and B go through, a pixel of principal point is worth Z^2 / (f B), a turn Z^2 / B."""
    cases = [
        (parallel({"shift_x": 0.1}), depth_mm * 0.1 / BASELINE_MM),
        (parallel({"right_cx_px": 0.5}), 0.5 * depth_mm**2 / (FOCAL_PX * BASELINE_MM)),
        (parallel({"left_fx_px": 2.0, "right_fx_px": 2.0}, shared=("fx_px",)), depth_mm * 2.0 / FOCAL_PX),
    ]
    for calibration, expected_mm in cases:
        np.testing.assert_allclose(depth_sigma(calibration, PIXELS, depth_mm), expected_mm, rtol=1e-3)
    turn = depth_sigma(parallel({"turn_y_rad": 1e-4}), PIXELS[:1], depth_mm)
    assert turn[0] == pytest.approx(1e-4 * depth_mm**2 / BASELINE_MM, rel=0.02)


def test_a_match_that_is_off_by_a_quarter_pixel_moves_depth_by_its_share() -> None:
    sigma = matching_sigma(parallel({}), PIXELS, 1000.0)
    np.testing.assert_allclose(sigma, 0.25 * 1000.0**2 / (FOCAL_PX * BASELINE_MM), rtol=1e-6)  # 5 mm


def test_baseline_and_scale_are_as_uncertain_as_the_shift() -> None:
    calibration = parallel({"shift_x": 0.1, "shift_y": 5.0})
    assert baseline_sigma(calibration) == pytest.approx(0.1)
    assert scale_sigma(calibration, 1000.0) == pytest.approx(0.1 / BASELINE_MM, rel=0.01)


@cache
def solved() -> Calibration:
    """A real calibration: six boards through the exact optics of an OAK-1, glass considered."""
    rig = Rig.read("oak-1")
    return solve(traced_detection(rig, 1, poses=6), Board(9, 7, SQUARE_MM), rig=rig).calibration


def drawn(calibration: Calibration, delta: Array) -> tuple[Camera, Camera]:
    """Both cameras with their 24 numbers moved."""

    def bent(lens: Lens, by: Array) -> Lens:
        k = tuple(float(a + b) for a, b in zip(lens.distortion, by[4:], strict=True))
        return Lens(lens.fx_px + by[0], lens.fy_px + by[1], lens.cx_px + by[2], lens.cy_px + by[3], (*k[:4], k[4]))

    left, right = calibration.left, calibration.right
    return replace(left, lens=bent(left.lens, delta[:9])), replace(
        right,
        lens=bent(right.lens, delta[9:18]),
        R_camera_from_left=rotations(delta[18:21]) @ right.R_camera_from_left,
        t_camera_from_left=right.t_camera_from_left + delta[21:],
    )


def test_depth_scatters_as_said_when_the_numbers_scatter_as_said() -> None:
    """500 draws from the covariance of a solved calibration, each triangulated afresh: no derivative is used."""
    calibration = solved()
    assert calibration.uncertainty is not None
    pixels = np.array([[800.0, 300.0], [1000.0, 360.0], [900.0, 600.0]])
    points = calibration.left.rays(pixels)
    reach = (1000.0 - points[0][:, 2]) / points[1][:, 2]
    right_px = calibration.right.project(points[0] + reach[:, None] * points[1])
    draws = np.random.default_rng(5).multivariate_normal(np.zeros(24), calibration.uncertainty.covariance, 500)
    depths = []
    for delta in draws:
        left, right = drawn(calibration, delta)
        depths.append(meet(left.rays(pixels), right.rays(right_px))[0][:, 2])
    np.testing.assert_allclose(np.std(depths, axis=0), depth_sigma(calibration, pixels, 1000.0), rtol=0.1)


def test_maps_stand_at_half_one_and_two_metres_and_at_the_near_end_over_the_common_field() -> None:
    maps = uncertainty_maps(solved())
    assert [one.depth for one in maps] == [400.0, 500.0, 1000.0, 2000.0]
    for one in maps:
        assert one.calibration_sigma.shape == one.pixels.shape[:2]
        assert np.isnan(one.calibration_sigma).any()  # behind a prism the views never share all of it
        np.testing.assert_array_equal(np.isnan(one.calibration_sigma), np.isnan(one.matching_sigma))
        assert one.typical <= one.worst
    assert maps[3].typical > 3 * maps[2].typical  # depth errors grow with the square of the distance


def test_a_finite_far_end_has_a_map_and_squares_have_no_metre() -> None:
    near_and_far = replace(parallel({"shift_x": 0.1}), range=RangeWish(near_mm=400.0, far_mm=1500.0, labels=128))
    assert [one.depth for one in uncertainty_maps(near_and_far)] == [400.0, 500.0, 1000.0, 1500.0, 2000.0]
    squares = replace(
        parallel({"shift_x": 0.1}, unit="square"), range=RangeWish(near_mm=5.0, far_mm=math.inf, labels=128)
    )
    assert [one.depth for one in uncertainty_maps(squares, (7.0, 700.0))] == [700.0]  # at 7 the views share nothing
    assert yardstick(squares) == 10.0
    assert yardstick(near_and_far) == 1000.0
    assert yardstick(replace(near_and_far, range=RangeWish(near_mm=100.0, far_mm=400.0, labels=128))) == 200.0


def test_a_calibration_without_a_covariance_has_no_map_and_says_so(oak: Rig) -> None:
    nominal = Calibration.nominal(oak)
    assert uncertainty_maps(nominal) == ()
    with pytest.raises(CalibrationError, match="does not say how well its numbers are known"):
        depth_sigma(nominal, PIXELS, 1000.0)
