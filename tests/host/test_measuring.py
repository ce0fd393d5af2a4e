"""Lengths come back with the error they say they have: maps made from equations, white noise, known calibrations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from host.measured_maps import ball_mm, geometry, middle_ray, plane_mm, relief, unit
from prismstereo.export.geometry import Geometries
from prismstereo.measuring import Patch, Relief, distance, fit_plane, fit_sphere, height_over
from prismstereo.measuring.fix import LEAN_PX, ROUNDING_PX, fix
from prismstereo_calibration.rectification import rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.errors import DataError, UsageError

NORMAL = np.array([0.2, -0.1, 1.0]) / np.linalg.norm([0.2, -0.1, 1.0])
NOISE_PX = 0.05


def points_at(seen, normal, h_mm, pixels):
    ray = np.stack([(pixels[:, 0] - seen.cx_px) / seen.focal_px, (pixels[:, 1] - seen.cy_px) / seen.focal_px], -1)
    ray = np.column_stack([ray, np.ones(len(ray))])
    return ray * (h_mm / (ray @ normal))[:, None]


def test_a_distance_is_that_of_the_equation() -> None:
    seen = geometry()
    flat = relief(seen, plane_mm(seen, NORMAL, 400.0))
    a, b = points_at(seen, NORMAL, 400.0, np.array([[100.5, 200.25], [500.0, 600.75]]))
    found = distance(flat, (100.5, 200.25), (500.0, 600.75))
    assert found.value_mm == pytest.approx(float(np.linalg.norm(a - b)), abs=1e-3)
    assert found.calibration_mm is None


def test_the_sigma_of_a_distance_covers_its_error() -> None:
    seen, rng = geometry(), np.random.default_rng(5)
    flat = relief(seen, plane_mm(seen, NORMAL, 400.0), NOISE_PX)
    pixels = rng.uniform([20, 20], [seen.width - 20, seen.height - 20], (120, 2))
    true = points_at(seen, NORMAL, 400.0, pixels)
    pulls = []
    for i in range(0, len(pixels), 2):
        found = distance(flat, tuple(pixels[i]), tuple(pixels[i + 1]))
        pulls.append((found.value_mm - np.linalg.norm(true[i] - true[i + 1])) / found.sigma_mm)
    assert (
        np.sqrt(np.mean(np.square(pulls))) <= 1.1
    )  # white noise averages out in the window: the sigma is on the safe side
    assert abs(np.mean(pulls)) <= 0.3


def test_the_noise_of_a_point_is_read_from_its_neighbours() -> None:
    seen = geometry()
    sigmas = [fix(relief(seen, plane_mm(seen, NORMAL, 400.0), NOISE_PX, seed), 300, 300).sigma_px for seed in range(8)]
    assert np.mean(sigmas) == pytest.approx(np.sqrt(NOISE_PX**2 + ROUNDING_PX**2 + LEAN_PX**2), rel=0.1)


def test_a_point_next_to_an_edge_is_of_its_own_surface() -> None:
    seen = geometry()
    depth = plane_mm(seen, np.array([0.0, 0.0, 1.0]), 500.0)
    depth[:, :300] = 420.0
    for column, true_mm in ((299, 420.0), (300, 500.0)):
        assert fix(relief(seen, depth, 0.02), column, 350).point[2] == pytest.approx(true_mm, abs=0.2)


def test_a_speckle_is_as_unsure_as_a_match_that_stands_alone() -> None:
    seen = geometry()
    depth = np.full((seen.height, seen.width), np.nan)
    depth[300, 300] = 400.0
    found = fix(relief(seen, depth), 300, 300)
    assert (found.sigma_px, found.point[2]) == (0.25, pytest.approx(400.0))


def test_an_uncertain_baseline_makes_every_length_as_uncertain() -> None:
    seen = geometry(0.05)
    flat = relief(seen, plane_mm(seen, NORMAL, 400.0))
    share = 0.05 / unit().baseline
    length = distance(flat, (100, 200), (500, 600))
    assert length.calibration_mm == pytest.approx(share * length.value_mm, rel=0.01)
    plane = fit_plane(flat, Patch(200, 200, 200, 200))
    assert plane.distance.calibration_mm == pytest.approx(share * 400.0, rel=0.05)
    height = height_over(relief(seen, np.where(np.arange(seen.width) > 500, 350.0, 400.0) * np.ones((seen.height, 1))),
                         fit_plane(flat, Patch(200, 200, 200, 200)), (600, 300))  # fmt: skip
    assert height.calibration_mm == pytest.approx(share * height.value_mm, rel=0.1)


def test_a_plane_comes_back_where_it_is() -> None:
    seen = geometry()
    depth = plane_mm(seen, NORMAL, 400.0)
    depth[300:330, 200:260] = 330.0  # a thing on it
    depth[::7] = np.nan
    found = fit_plane(relief(seen, depth, NOISE_PX), Patch(150, 200, 300, 300))
    assert found.distance.value_mm == pytest.approx(400.0, abs=3 * found.distance.sigma_mm)
    assert found.distance.sigma_mm < 0.3
    np.testing.assert_allclose(found.normal, NORMAL, atol=1e-3)
    assert found.tilt_deg == pytest.approx(np.degrees(np.arccos(NORMAL[2])), abs=3 * found.tilt_sigma_deg)
    assert found.rms_px == pytest.approx(NOISE_PX, rel=0.05)
    assert found.share == pytest.approx(1 - 30 * 60 / (300 * 300), abs=0.01)


def test_a_height_is_told_with_its_side() -> None:
    seen = geometry()
    depth = plane_mm(seen, NORMAL, 400.0)
    depth[300:340, 400:440] = plane_mm(seen, NORMAL, 380.0)[300:340, 400:440]
    depth[300:340, 460:500] = plane_mm(seen, NORMAL, 405.0)[300:340, 460:500]
    shown = relief(seen, depth, NOISE_PX)
    ground = fit_plane(shown, Patch(100, 200, 250, 250))
    for column, true_mm in ((420, 20.0), (480, -5.0)):
        found = height_over(shown, ground, (column, 320))
        assert found.value_mm == pytest.approx(true_mm, abs=3 * found.sigma_mm)
        assert found.sigma_mm < 0.3


def test_a_ball_has_its_radius() -> None:
    seen = geometry()
    centre = 460.0 * middle_ray(seen)
    depth = ball_mm(seen, centre, 60.0)
    depth = np.where(np.isfinite(depth), depth, 700.0)
    found = fit_sphere(relief(seen, depth, NOISE_PX), Patch(80, 120, 480, 480))
    assert found.radius.value_mm == pytest.approx(60.0, abs=0.03)
    assert abs(found.radius.value_mm - 60.0) <= 3 * found.radius.sigma_mm
    np.testing.assert_allclose(found.centre, centre, atol=0.1)
    assert found.rms_px == pytest.approx(NOISE_PX, rel=0.05)


def test_a_flat_thing_is_no_ball_and_a_ball_is_not_flat() -> None:
    seen = geometry()
    with pytest.raises(UsageError, match="no ball"):
        fit_sphere(
            relief(seen, np.random.default_rng(1).uniform(300, 900, (seen.height, seen.width))), Patch(0, 0, 200, 200)
        )
    noisy = np.random.default_rng(1).uniform(300, 900, (seen.height, seen.width))
    with pytest.raises(UsageError, match="no plane"):
        fit_plane(relief(seen, noisy), Patch(0, 0, 200, 200))


def test_what_cannot_be_measured_is_said_in_one_sentence() -> None:
    seen = geometry()
    depth = np.full((seen.height, seen.width), np.nan)
    empty = relief(seen, depth)
    with pytest.raises(UsageError, match="nor anywhere else"):
        distance(empty, (10, 10), (20, 20))
    with pytest.raises(UsageError, match="0 of the 100 pixels"):
        fit_plane(empty, Patch(0, 0, 10, 10))
    with pytest.raises(UsageError, match="0 of the 100 pixels"):
        fit_sphere(empty, Patch(0, 0, 10, 10))
    depth[100:140, 100:140] = 400.0
    some = relief(seen, depth)
    with pytest.raises(UsageError, match="the nearest match is at 100,100"):
        distance(some, (90, 90), (110, 110))
    with pytest.raises(UsageError, match="outside of the map"):
        distance(some, (-3, 90), (110, 110))
    with pytest.raises(UsageError, match="two different ones"):
        distance(some, (110, 110), (110, 110))
    with pytest.raises(UsageError, match="reaches out of the map"):
        fit_plane(some, Patch(seen.width - 5, 0, 10, 10))
    with pytest.raises(UsageError, match="holds no pixel"):
        Patch(0, 0, 0, 10)


def test_a_line_of_pixels_is_no_plane() -> None:
    seen = geometry()
    flat = relief(seen, plane_mm(seen, NORMAL, 400.0))
    with pytest.raises(UsageError, match="no plane"):
        fit_plane(flat, Patch(100, 100, 200, 1))


def test_a_map_of_one_pixel_and_one_of_twenty_megapixels_are_measured() -> None:
    small = Relief(np.array([[200.0]]), replace(geometry(), width=1, height=1))
    assert fix(small, 0, 0).point[2] == pytest.approx(small.scale_px / 200.0)
    with pytest.raises(UsageError, match="1 of the 1 pixels"):
        fit_plane(small, small.whole)
    large = replace(geometry(), width=5000, height=4000)
    found = fit_plane(Relief(np.full((4000, 5000), 200.0), large), Patch(0, 0, 5000, 4000))
    assert found.distance.value_mm == pytest.approx(large.window.scale_px / 200.0)


def test_what_a_filter_filled_in_is_not_measured() -> None:
    made = rectification(unit())
    found = np.full((made.height, made.width), 100, np.float32)
    filled = np.zeros(found.shape, bool)
    filled[50:60, 50:60] = True
    shown = Relief.of(DisparityMap(found, made.window, filled=filled), Geometries(unit()))
    assert np.isnan(shown.inverse_px[55, 55])
    assert np.isfinite(shown.inverse_px[70, 70])


def test_a_calibration_that_does_not_belong_or_has_no_scale_is_refused() -> None:
    made = rectification(unit())
    with pytest.raises(DataError, match="none of this calibration's"):
        Relief.of(DisparityMap(np.ones((10, 10), np.float32), made.window), Geometries(unit()))
    squares = replace(
        unit(), unit="square", left=replace(unit().left, plate=None), right=replace(unit().right, plate=None)
    )
    made = rectification(squares)
    with pytest.raises(UsageError, match="--square-mm"):
        Relief.of(DisparityMap(np.ones((made.height, made.width), np.float32), made.window), Geometries(squares))
