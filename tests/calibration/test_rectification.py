"""Rectification: matches lie on one row, their distance tells the depth, and the views fill the picture."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, RectifiedView, rectification
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import View

NOMINAL = {name: Calibration.nominal(Rig.read(name)) for name in ("dslr-35mm", "oak-1", "pi-camera-v2")}


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    """Nominal calibrations as a built unit would have them: turned a little, shifted, with a lens of its own."""
    ideal = NOMINAL[draw(st.sampled_from(sorted(NOMINAL)))]
    small = st.floats(-0.02, 0.02)
    turn = cv2.Rodrigues(np.array([draw(small), draw(small), draw(small)]))[0]
    lens = dataclasses.replace(
        ideal.left.lens,
        cx_px=ideal.left.lens.cx_px + draw(st.floats(-20, 20)),
        cy_px=ideal.left.lens.cy_px + draw(st.floats(-20, 20)),
        fy_px=ideal.left.lens.fy_px * draw(st.floats(0.99, 1.01)),
        distortion=(draw(st.floats(-0.1, 0.1)), draw(st.floats(-0.05, 0.05)), draw(st.floats(-2e-3, 2e-3)), 0.0, 0.0),
    )
    right = Camera(
        lens,
        turn @ ideal.right.R_camera_from_left,
        ideal.right.t_camera_from_left + np.array([draw(small), draw(small), draw(small)]) * 20,
    )
    return dataclasses.replace(
        ideal, left=Camera.at_origin(lens), right=right, range=RangeWish(near_mm=600, far_mm=math.inf, labels=256)
    )


def seen_by_both(calibration: Calibration, depths_mm: np.ndarray) -> np.ndarray:
    """Points (N, 3) of the left camera's frame at depths of all sizes, in the directions both views look."""
    made = rectification(calibration)
    R = made.left.R_rectified_from_left
    slopes = np.stack(np.meshgrid(np.linspace(-0.15, 0.15, 7), np.linspace(-0.12, 0.12, 5)), axis=-1).reshape(-1, 2)
    middle = calibration.right.centre / 2
    rays = np.column_stack([slopes, np.ones(len(slopes))]) @ R
    return middle + (depths_mm[:, None, None] * rays).reshape(-1, 3)


@given(calibrations(), st.lists(st.floats(250, 50_000), min_size=3, max_size=3))
def test_a_point_lies_on_one_row_of_both_pictures_at_the_disparity_of_its_depth(
    calibration: Calibration, depths: list[float]
) -> None:
    made = rectification(calibration)
    points = seen_by_both(calibration, np.array(depths))
    left = made.rectify(calibration.left.project(points), made.left)
    right = made.rectify(calibration.right.project(points), made.right)
    depth = (points @ made.left.R_rectified_from_left.T)[:, 2]

    np.testing.assert_allclose(left[:, 1], right[:, 1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        left[:, 0] - right[:, 0], made.window.scale_px / depth - made.window.offset_px, rtol=0, atol=1e-9
    )


@given(calibrations())
def test_the_scale_is_focal_length_times_baseline(calibration: Calibration) -> None:
    made = rectification(calibration)
    assert made.window.scale_px == pytest.approx(made.focal_px * calibration.baseline)
    lens = calibration.left.lens
    assert made.focal_px == pytest.approx((lens.fx_px + lens.fy_px) / 2)


@given(calibrations())
def test_both_turns_are_rotations_onto_one_frame_along_the_baseline(calibration: Calibration) -> None:
    made = rectification(calibration)
    for side in (made.left, made.right):
        R = side.R_rectified_from_left
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(R) == pytest.approx(1)
    baseline = made.left.R_rectified_from_left @ calibration.right.centre
    np.testing.assert_allclose(baseline, [calibration.baseline, 0, 0], atol=1e-9)


def check_inverse(made: Rectification, side: RectifiedView) -> None:
    sources = made.sources(side).astype(float)
    seen = np.isfinite(sources[..., 0])
    x, y, _, _ = side.view.rectangle(made.frame_width, made.frame_height)
    back = made.rectify(sources[seen] + [x, y], side)
    rows, columns = np.nonzero(seen)
    # float32 source pixels of up to 1280 are exact to 6e-5
    np.testing.assert_allclose(back, np.stack([columns, rows], axis=-1), rtol=0, atol=5e-4)


def test_the_map_to_raw_pixels_is_the_inverse_of_the_way_from_them(rectified: Rectification) -> None:
    check_inverse(rectified, rectified.left)
    check_inverse(rectified, rectified.right)


def test_every_pixel_of_the_map_lies_in_its_view(rectified: Rectification) -> None:
    for side in (rectified.left, rectified.right):
        sources = rectified.sources(side)
        seen = np.isfinite(sources).all(axis=-1)
        np.testing.assert_array_equal(seen, np.isfinite(sources).any(axis=-1))
        w, h = side.view.upright_size(rectified.frame_width, rectified.frame_height)
        assert sources[seen].min() >= 0
        assert np.all(sources[seen] <= [w - 1, h - 1])


@pytest.mark.parametrize(
    "distortion", [(-0.16, 0.0, 0.0, 0.0, 0.0), (0.0, -0.1, 0.0, 0.0, 0.0), (-0.18, 0.008, 0.0, 0.0, 0.0)]
)
def test_a_lens_that_folds_in_its_corners_shows_nothing_twice(distortion: tuple[float, ...]) -> None:
    # far off the axis such a polynomial turns back into the picture, the last one even out of it again: what lies there
    # must not be shown as if it were in the middle
    lens, whole = Lens(700, 700, 639.5, 359.5, distortion), View(left=0, top=0, width=1, height=1)
    calibration = dataclasses.replace(
        NOMINAL["oak-1"], left=Camera.at_origin(lens), right=Camera(lens, np.eye(3), np.array([-50.0, 0, 0])),
        left_view=whole, right_view=whole,
    )  # fmt: skip
    made = rectification(calibration)
    left = dataclasses.replace(made.left, cx_px=800.0)
    sources = dataclasses.replace(made, focal_px=200.0, width=1600, height=900, cy_px=450.0).sources(left)
    ways = sources[450, 800:], sources[450, 800::-1], np.stack([sources[450 + k, 800 + 2 * k] for k in range(400)])
    for outward in ways:
        column = np.abs(outward[:, 0] - 639.5)
        lit = np.isfinite(column)
        assert lit[0]
        assert np.all(np.diff(column[lit]) > 0)  # outward is outward
        assert not lit[np.argmin(lit) :].any()  # and dark stays dark


# ---- the wished range


def test_the_rigs_own_window_is_that_of_its_file(rig: Rig, rectified: Rectification) -> None:
    assert rectified.window.labels == rig.range.labels
    assert rectified.window.farthest == math.inf
    assert rectified.window.offset_px == -1.0
    assert rectified.window.nearest <= rig.range.near_mm


@pytest.mark.parametrize(("near", "far"), [(400.0, 1500.0), (600.0, math.inf), (1000.0, 1200.0), (3000.0, 20_000.0)])
def test_a_wished_range_is_granted_with_as_many_labels_as_it_needs(
    nominal: Calibration, near: float, far: float
) -> None:
    made = rectification(nominal, RangeWish(near_mm=near, far_mm=far, labels=16))
    assert made.window.nearest <= near
    assert made.window.farthest == pytest.approx(far)
    assert made.left.cx_px - made.right.cx_px == pytest.approx(-made.window.offset_px)


def test_labels_alone_go_with_the_calibrations_own_range(nominal: Calibration) -> None:
    assert rectification(nominal, labels=512).window.labels == 512
    with pytest.raises(UsageError, match="but 64 are searched: begin at"):
        rectification(nominal, labels=64)


def test_a_range_that_the_labels_do_not_reach_is_refused(nominal: Calibration) -> None:
    with pytest.raises(UsageError, match=r"range 50:inf needs \d+ disparity labels, but 128 are searched"):
        rectification(nominal, RangeWish(near_mm=50, far_mm=math.inf, labels=128), labels=128)


def test_a_calibration_in_squares_is_rectified_in_squares() -> None:
    ideal = NOMINAL["oak-1"].pinholes()
    squares = dataclasses.replace(
        ideal, unit="square",
        right=dataclasses.replace(ideal.right, t_camera_from_left=ideal.right.t_camera_from_left / 25.0),
        range=RangeWish(near_mm=400 / 25, far_mm=math.inf, labels=128),
    )  # fmt: skip
    made, in_mm = rectification(squares), rectification(ideal)
    assert made.unit == "square"
    assert made.window.nearest == pytest.approx(in_mm.window.nearest / 25)
    np.testing.assert_array_equal(made.sources(made.left), in_mm.sources(in_mm.left))


# ---- what is in the picture


def test_the_views_and_not_the_principal_point_are_in_the_picture(rig: Rig, rectified: Rectification) -> None:
    for side in (rectified.left, rectified.right):
        seen = np.isfinite(rectified.sources(side)[..., 0])
        assert seen.mean() > 0.65
    # the principal point of each half lies on its border: centring that would have shown half of it
    assert 0.2 * rectified.width < rectified.left.cx_px < 0.8 * rectified.width


@pytest.mark.parametrize(("distance_mm", "share"), [(0.0, 0.73), (1000.0, 0.92), (1e6, 0.99)])
def test_most_of_what_both_views_see_has_a_place(
    nominal: Calibration, rectified: Rectification, distance_mm: float, share: float
) -> None:
    # at the near end 254 of the DSLR's 640 columns are disparity: no picture of that width could hold more than 0.75
    depth = distance_mm or rectified.window.nearest
    left_pixels = np.stack(np.meshgrid(np.linspace(640, 1279, 81), [359.5]), axis=-1).reshape(-1, 2)
    left = rectified.rectify(left_pixels, rectified.left)
    disparity = rectified.window.scale_px / depth - rectified.window.offset_px
    right = left - [disparity, 0]
    direction = np.column_stack([(right - [rectified.right.cx_px, rectified.cy_px]) / rectified.focal_px, np.ones(81)])
    points = rectified.right.pinhole + depth * (direction @ rectified.right.R_rectified_from_left)
    right_pixels = nominal.right.project(points)
    both = (right_pixels[:, 0] >= 0) & (right_pixels[:, 0] <= 639)
    placed = (
        (left[:, 0] >= 0)
        & (left[:, 0] <= rectified.width - 1)
        & (right[:, 0] >= 0)
        & (right[:, 0] <= rectified.width - 1)
    )
    assert both.any()
    assert np.count_nonzero(both & placed) / np.count_nonzero(both) > share


def test_the_middle_row_of_the_views_is_in_the_middle(rectified: Rectification, nominal: Calibration) -> None:
    for camera, side, x in ((nominal.left, rectified.left, 959.5), (nominal.right, rectified.right, 319.5)):
        middle = rectified.rectify(np.array([x, 359.5]), side)
        assert middle[1] == pytest.approx((rectified.height - 1) / 2, abs=1.0)
        assert camera.lens == side.camera.lens


def test_points_are_depths_along_the_pixels_own_rays(rectified: Rectification) -> None:
    depth = np.full((rectified.height, rectified.width), np.nan, np.float32)
    depth[100, 200] = 750.0
    point = rectified.points(depth)[100, 200].astype(float)
    assert point[2] == 750.0
    assert rectified.focal_px * point[0] / 750 + rectified.left.cx_px == pytest.approx(200, abs=1e-3)
    assert rectified.focal_px * point[1] / 750 + rectified.cy_px == pytest.approx(100, abs=1e-3)
    assert np.isnan(rectified.points(depth)).sum() == 3 * (depth.size - 1)


# ---- turned and mirrored views


@pytest.mark.parametrize("turn_deg", [0, 90, 180, 270])
@pytest.mark.parametrize("mirrored", [False, True])
def test_views_that_stand_otherwise_in_the_frame_are_rectified_in_their_upright_pixels(
    turn_deg: int, mirrored: bool
) -> None:
    halves = {"turn_deg": turn_deg, "mirrored": mirrored, "top": 0.0, "width": 0.5, "height": 1.0}
    left, right = View(left=0.0, **halves), View(left=0.5, **halves)
    w, h = left.upright_size(800, 500)
    lens = {x: Lens(600, 600, x + (w - 1) / 2, (h - 1) / 2) for x in (0, 400)}
    calibration = Calibration(
        "any", 800, 500, left, right, Camera.at_origin(lens[0]), Camera(lens[400], np.eye(3), np.array([-60.0, 0, 0])),
        RangeWish(near_mm=500, far_mm=math.inf, labels=128),
    )  # fmt: skip
    made = rectification(calibration)
    assert (made.width, made.height) == (w, h)
    check_inverse(made, made.left)
    check_inverse(made, made.right)
    point = np.array([10.0, 20.0, 900.0])
    found = [
        made.rectify(camera.project(point), side)
        for camera, side in ((calibration.left, made.left), (calibration.right, made.right))
    ]
    assert found[0][1] == pytest.approx(found[1][1])
    assert found[0][0] - found[1][0] == pytest.approx(600 * 60 / 900 + 1)


def test_a_lens_that_folds_before_the_border_of_a_view_is_rectified_up_to_there() -> None:
    plain = Lens(700.0, 700.0, 0.0, 180.0)
    folding = dataclasses.replace(plain, distortion=(0.0, 0.0, 0.0, 0.0, -1 / 64))
    assert np.isnan(folding.slopes(np.array([1279.0, 180.0]))).any()
    calibration = dataclasses.replace(
        NOMINAL["oak-1"],
        left_view=View(left=0.0, top=0.5, width=1.0, height=0.5),
        right_view=View(left=0.0, top=0.0, width=1.0, height=0.5),
        left=Camera.at_origin(dataclasses.replace(plain, cy_px=540.0)),
        right=Camera(folding, np.eye(3), np.array([-10.0, 0.0, 0.0])),
    )
    made = rectification(calibration)
    points = np.array([[200.0, 20.0, 1000.0], [900.0, -30.0, 2000.0]])
    left, right = (made.rectify(side.camera.project(points), side) for side in (made.left, made.right))
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-6)
    np.testing.assert_allclose(made.window.depth((left - right)[:, 0].astype(np.float32)), points[:, 2], rtol=1e-4)
