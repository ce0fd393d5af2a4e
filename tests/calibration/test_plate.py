"""Glass before a camera: the closed form against the rig's own optics, its derivatives, and what it does to disparity."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.nominal import nominal_plate
from prismstereo_calibration.plate import Plate
from prismstereo_calibration.rectification import Rectification
from prismstereo_calibration.solving.projection import numbers_of, project
from prismstereo_hw.lens import Lens
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig

PLATE = Plate(22.0, 1.5168)
LENS = Lens(935.0, 935.0, 639.5, 359.5, (-0.06, 0.03, 1e-3, -1e-3, 0.01))
POINTS = np.random.default_rng(3).uniform([-200, -150, 300], [200, 150, 900], (60, 3))


def test_the_plate_of_a_prism_rig_is_as_thick_as_the_prism_is_high(rig: Rig) -> None:
    plate = nominal_plate(rig)
    assert plate is not None
    assert plate.thickness_mm == pytest.approx(rig.prism.side_mm * math.sqrt(3) / 2)
    assert plate.index == pytest.approx(1.5168, abs=1e-4)


def test_points_are_seen_where_the_traced_optics_see_them(rig: Rig) -> None:
    view, plate = fold(rig, "left"), nominal_plate(rig)
    assert plate is not None
    np.testing.assert_allclose(plate.slopes(view.view_from_rig(POINTS)), view.slopes(POINTS), rtol=0, atol=1e-12)


def test_a_thin_plate_is_no_plate() -> None:
    np.testing.assert_allclose(Plate(1e-9, 1.5).slopes(POINTS), POINTS[:, :2] / POINTS[:, 2:], atol=1e-12)


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(100, 1e5))
def test_a_point_lies_on_the_ray_of_its_pixel(a: float, b: float, distance_mm: float) -> None:
    camera = Camera.at_origin(LENS, PLATE)
    point = distance_mm * np.array([a, b, 1.0])
    origin, direction = camera.rays(camera.project(point))
    assert np.linalg.norm(np.cross(point - origin, direction)) < 1e-9 * distance_mm


def test_the_derivatives_are_those_of_differences() -> None:
    found = project(numbers_of(LENS), POINTS, PLATE)
    np.testing.assert_allclose(found.pixels, Camera.at_origin(LENS, PLATE).project(POINTS), rtol=0, atol=1e-9)
    for axis, step in enumerate(np.eye(3) * 1e-4):
        rise = (
            project(numbers_of(LENS), POINTS + step, PLATE).pixels
            - project(numbers_of(LENS), POINTS - step, PLATE).pixels
        )
        np.testing.assert_allclose(found.by_point[..., axis], rise / 2e-4, rtol=1e-5, atol=1e-6)


def test_on_the_axis_the_plate_moves_the_pinhole_by_its_paraxial_shift() -> None:
    off_axis = PLATE.crossing_mm(np.array([[0.0, 0.0], [0.5, 0.0]]))
    assert off_axis[0] == pytest.approx(0.0, abs=1e-12)
    t = math.atan(0.5)
    exact = 22.0 * (1 - math.cos(t) / math.sqrt(1.5168**2 - math.sin(t) ** 2)) - 22.0 * (1 - 1 / 1.5168)
    assert off_axis[1] == pytest.approx(exact, abs=1e-9)


def test_bk7_reflects_up_to_half_of_58_degrees() -> None:
    edge = math.tan(math.radians(58.4 / 2))
    assert PLATE.admits(np.array([edge - 0.002, 0.0]))
    assert not PLATE.admits(np.array([edge + 0.002, 0.0]))
    assert Plate(22.0, 1.8).admits(np.array([0.9, 0.0]))  # flint reflects all of a wide lens


@pytest.mark.parametrize(("thickness_mm", "index"), [(0.0, 1.5), (math.nan, 1.5), (2e3, 1.5), (22.0, 1.0), (22.0, 9.0)])
def test_what_is_no_glass_is_refused(thickness_mm: float, index: float) -> None:
    with pytest.raises(CalibrationError, match="glass plate"):
        Plate(thickness_mm, index)


def seen_at(nominal: Calibration, rectified: Rectification, depth_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Left rectified pixels and disparities of points at one depth, of all of the left view that the right one shares."""
    pixels = np.stack(np.meshgrid(np.linspace(645, 1275, 30), np.linspace(5, 715, 20)), axis=-1).reshape(-1, 2)
    pixels = pixels[PLATE.admits(nominal.left.lens.slopes(pixels))]
    origin, direction = nominal.left.rays(pixels)
    ahead = rectified.left.R_rectified_from_left[2]
    reach = (depth_mm - (origin - rectified.left.pinhole) @ ahead) / (direction @ ahead)
    upright = nominal.right.project(origin + reach[:, None] * direction)
    left, right = rectified.rectify(pixels, rectified.left), rectified.rectify(upright, rectified.right)
    kept = ((left >= 0) & (left <= [639, 719])).all(axis=1) & (right[:, 0] >= 0) & (upright[:, 0] <= 639)
    return left[kept], (left - right)[kept, 0]


@pytest.mark.parametrize("depth_mm", [450.0, 600.0, 1000.0, 2000.0, 20_000.0])
def test_disparity_becomes_depth_without_what_the_glass_does(
    nominal: Calibration, rectified: Rectification, depth_mm: float
) -> None:
    window = rectified.window
    assert window.glass is not None
    pixels, disparity = seen_at(nominal, rectified, depth_mm)
    full = np.full((720, 640), np.nan, np.float32)
    columns, rows = np.rint(pixels).astype(int).T
    full[rows, columns] = disparity
    missing = window.glass.missing_px(full)[rows, columns]
    ideal = window.scale_px / depth_mm - window.offset_px
    assert np.abs(disparity + missing - ideal).max() < 0.06
    assert np.median(np.abs(disparity + missing - ideal)) < 0.015
    assert np.median(window.depth_map(full)[rows, columns]) == pytest.approx(depth_mm, rel=1e-4 * depth_mm / 450)
