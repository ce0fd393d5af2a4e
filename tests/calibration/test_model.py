"""The calibration: what the rig file promises, and which numbers no camera can have."""

from __future__ import annotations

import dataclasses
import math
import re

import msgspec
import numpy as np
import pytest

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_hw.errors import PrismStereoError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.lens import Lens
from prismstereo_hw.optics.figures import figures
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import View


@pytest.fixture(scope="module")
def sane(oak: Rig) -> Calibration:
    return Calibration.nominal(oak)


# ---- what the rig file promises


def test_the_nominal_baseline_is_the_paraxial_one(rig: Rig, nominal: Calibration) -> None:
    assert nominal.baseline == pytest.approx(figures(rig).baseline_paraxial_mm, abs=1e-9)
    assert nominal.left.lens == nominal.right.lens == rig.lens()


def test_the_nominal_cameras_project_like_the_exact_optics(rig: Rig, nominal: Calibration) -> None:
    views, random = (fold(rig, "left"), fold(rig, "right")), np.random.default_rng(1)
    points = random.uniform([-100, -100, 300], [100, 100, 3000], (200, 3))
    in_left = views[0].view_from_rig(points)
    for view, camera in zip(views, (nominal.left, nominal.right), strict=True):
        exact = rig.lens().project_slopes(view.slopes(points))
        np.testing.assert_allclose(camera.project(in_left), exact, rtol=0, atol=1e-9)


def test_the_nearest_pinholes_have_a_baseline_that_the_glass_makes_longer(rig: Rig, nominal: Calibration) -> None:
    assert 0 < nominal.pinholes().baseline - nominal.baseline < 0.5
    assert nominal.pinholes().left.plate is None


def test_the_lens_of_the_nearest_pinholes_is_the_true_one_within_what_the_glass_bends(
    rig: Rig, nominal: Calibration
) -> None:
    true, fitted = rig.lens(), nominal.pinholes().left.lens
    assert fitted == nominal.pinholes().right.lens  # one lens
    assert fitted.fx_px == pytest.approx(true.fx_px, rel=2e-3)
    assert (fitted.cx_px, fitted.cy_px) == (true.cx_px, true.cy_px)
    assert max(map(abs, fitted.distortion)) < 0.01


def test_the_nominal_pinholes_stand_level_and_look_apart_as_the_mirrors_make_them(
    rig: Rig, nominal: Calibration
) -> None:
    R, t = nominal.right.R_camera_from_left, nominal.right.t_camera_from_left
    half = 2 * math.radians(60 - rig.mirrors.angle_deg)  # each optical axis is turned outward by this
    turn = np.array(
        [[math.cos(2 * half), 0, -math.sin(2 * half)], [0, 1, 0], [math.sin(2 * half), 0, math.cos(2 * half)]]
    )
    np.testing.assert_allclose(R, turn, atol=1e-9)
    np.testing.assert_allclose(t, nominal.baseline * np.array([-math.cos(half), 0, -math.sin(half)]), atol=1e-9)


def test_the_nearest_pinholes_project_like_the_exact_optics(rig: Rig, nominal: Calibration) -> None:
    # reference: f, k1 and k2 fitted to 0.3 to 3 m leave rms 0.05 px, max 0.19 (DSLR) and 0.11, 0.42 (OAK-1). These are
    # fitted from the near end of the range to infinity, and judged in the far corners too: half as much again
    rms_px, most_px = (0.08, 0.4) if rig.name == "dslr-35mm" else (0.17, 1.05)
    left, lens = fold(rig, "left"), rig.lens()
    columns, rows = np.meshgrid(np.linspace(641, 1279, 40), np.linspace(0, 719, 24))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)
    slopes = lens.slopes(pixels)
    kept = view_fates(rig, "left", slopes).fate == 0
    origin, direction = left.rays(slopes[kept])
    start = left.paraxial_centre_mm
    nearest = nominal.nearest_pinholes()
    off = []
    for depth_mm in rig.range.near_mm * np.array([1.0, 2.0, 10.0, 1000.0]):
        points = origin + (depth_mm - origin[:, 2:]) / direction[:, 2:] * direction
        seen = nearest.left.project((points - start) @ left.R.T - [0, 0, nearest.shift])
        off.append(np.linalg.norm(seen - pixels[kept], axis=1))
    assert np.sqrt(np.mean(np.square(off))) < rms_px
    assert np.max(off) < most_px


def test_the_nominal_calibration_speaks_of_its_rig(rig: Rig, nominal: Calibration) -> None:
    assert (nominal.rig, nominal.unit, nominal.model) == (rig.name, "mm", "one-lens")
    assert (nominal.frame_width, nominal.frame_height) == (1280, 720)
    assert nominal.views == rig.views
    assert nominal.range == rig.range
    assert nominal.left.centre == pytest.approx([0, 0, 0])


# ---- cameras


def test_a_camera_sees_a_point_along_the_ray_of_its_pixel(sane: Calibration) -> None:
    points = np.array([[10.0, -20.0, 700.0], [-60.0, 30.0, 500.0]])
    for camera in (sane.left, sane.right):
        origin, ray = camera.rays(camera.project(points))
        np.testing.assert_allclose(np.cross(points - origin, ray), 0, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1)


def test_a_point_behind_a_camera_has_no_pixel(sane: Calibration) -> None:
    assert np.isnan(sane.right.project(np.array([0.0, 0.0, -500.0]))).all()


# ---- frames that belong


def test_a_frame_of_the_calibrated_size_and_focus_is_taken(sane: Calibration) -> None:
    pixels = np.zeros((720, 1280), np.uint8)
    sane.require_frame(RawFrame(pixels))
    sane.require_frame(RawFrame(pixels, lens_position=120))  # this calibration does not say at which it was made
    focused = dataclasses.replace(sane, lens_position=120)
    focused.require_frame(RawFrame(pixels))  # this camera does not tell
    focused.require_frame(RawFrame(pixels, lens_position=120))


def test_a_frame_of_another_size_is_refused(sane: Calibration) -> None:
    with pytest.raises(
        CalibrationError, match=r"frame 4 is 640x720, but the calibration of 'oak-1' is for 1280x720: cal"
    ):
        sane.require_frame(RawFrame(np.zeros((720, 640), np.uint8), index=4))


def test_a_frame_at_another_focus_is_refused(sane: Calibration) -> None:
    focused = dataclasses.replace(sane, lens_position=120)
    with pytest.raises(CalibrationError, match=r"taken at lens position 121, .* is for 120: lock the focus there"):
        focused.require_frame(RawFrame(np.zeros((720, 1280), np.uint8), lens_position=121))


# ---- what no camera can be


def with_lens(calibration: Calibration, side: str, **values: float) -> Calibration:
    camera: Camera = getattr(calibration, side)
    return dataclasses.replace(
        calibration, **{side: dataclasses.replace(camera, lens=dataclasses.replace(camera.lens, **values))}
    )


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["fx_px", "fy_px", "cx_px", "cy_px"])
def test_a_lens_with_a_number_that_is_none_is_refused(sane: Calibration, side: str, field: str, value: float) -> None:
    with pytest.raises(CalibrationError, match=f"{side} camera has a number that is not finite"):
        with_lens(sane, side, **{field: value})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"fx_px": 100.0, "fy_px": 100.0},
            "has focal lengths 100.0, 100.0 px on a frame 1280 px wide: no lens is like that",
        ),
        ({"fx_px": 1e5, "fy_px": 1e5}, "no lens is like that"),
        ({"fy_px": 100.0}, "has focal lengths"),
        ({"fy_px": 0.0}, "has focal lengths"),
        ({"fy_px": -933.0}, "has focal lengths"),
        ({"fx_px": -933.0, "fy_px": -933.0}, "has focal lengths"),
        ({"cx_px": -1300.0}, "has its principal point at -1300.0, 359.5 px, far outside the frame of 1280x720"),
        ({"cy_px": 3000.0}, "far outside the frame"),
        ({"distortion": (math.nan, 0, 0, 0, 0)}, "not finite"),
        ({"distortion": (-3.0, 0, 0, 0, 0)}, "distortion (-3.0, 0, 0, 0, 0) folds the picture inside its own view"),
        (
            {"distortion": (0, 0, 0, 0, -200.0)},
            "folds the picture inside its own view: calibrate again with corners near",
        ),
    ],
)
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_lens_like_no_lens_is_refused_with_its_side(
    sane: Calibration, side: str, values: dict[str, float], words: str
) -> None:
    with pytest.raises(CalibrationError, match=re.escape(words)) as caught:
        with_lens(sane, side, **values)
    assert str(caught.value).startswith(f"{side} camera")


def with_pose(calibration: Calibration, R: np.ndarray, t: np.ndarray) -> Calibration:
    return dataclasses.replace(calibration, right=Camera(calibration.right.lens, R, t))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_pose_with_a_number_that_is_none_is_refused(sane: Calibration, value: float) -> None:
    R, t = sane.right.R_camera_from_left, sane.right.t_camera_from_left
    for bad in ((np.where(np.eye(3) > 0, value, R), t), (R, np.array([value, 0, 0]))):
        with pytest.raises(CalibrationError, match="pose of the right camera has a number that is not finite"):
            with_pose(sane, *bad)


@pytest.mark.parametrize(
    "R", [2 * np.eye(3), np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3)), np.eye(3) + 1e-4 * np.ones((3, 3))]
)
def test_what_is_no_rotation_is_refused(sane: Calibration, R: np.ndarray) -> None:
    with pytest.raises(CalibrationError, match="R_right_from_left is not a rotation: the file was damaged"):
        with_pose(sane, R, sane.right.t_camera_from_left)


def test_exchanged_sides_are_refused(sane: Calibration) -> None:
    R, t = sane.right.R_camera_from_left, sane.right.t_camera_from_left
    with pytest.raises(CalibrationError, match="not to its right: left and right are exchanged; give the frames"):
        with_pose(sane, R.T, -R.T @ t)


def test_cameras_in_one_place_are_refused(sane: Calibration) -> None:
    with pytest.raises(CalibrationError, match="not to its right"):
        with_pose(sane, np.eye(3), np.zeros(3))


def test_a_left_camera_that_is_not_the_origin_is_refused(sane: Calibration) -> None:
    for R, t in ((np.eye(3), np.array([1.0, 0, 0])), (sane.right.R_camera_from_left, np.zeros(3))):
        with pytest.raises(CalibrationError, match="the left camera does not stand at the origin"):
            dataclasses.replace(sane, left=Camera(sane.left.lens, R, t))


@pytest.mark.parametrize("size", [(0, 720), (1280, 0), (-1280, 720), (1_000_000, 720), (1280, 20_000)])
def test_frames_that_no_sensor_gives_are_refused(sane: Calibration, size: tuple[int, int]) -> None:
    with pytest.raises(CalibrationError, match=rf"is for frames of {size[0]}x{size[1]}: no sensor gives"):
        dataclasses.replace(sane, frame_width=size[0], frame_height=size[1])


def test_a_view_of_next_to_nothing_is_refused(sane: Calibration) -> None:
    sliver = View(left=0.0, top=0.0, width=0.01, height=1.0)
    with pytest.raises(
        CalibrationError, match="the right view is 13x720 pixels of a frame of 1280x720: give rectangles"
    ):
        dataclasses.replace(sane, right_view=sliver)


def test_a_rig_that_shows_next_to_nothing_has_no_nominal_calibration(oak: Rig) -> None:
    blind = msgspec.structs.replace(oak, mirrors=msgspec.structs.replace(oak.mirrors, offset_mm=1000.0))
    with pytest.raises(PrismStereoError, match=r"rig 'oak-1' shows (next to )?nothing.*: see `prismstereo design`"):
        Calibration.nominal(blind)


def test_a_lens_is_compared_by_its_numbers() -> None:
    assert Lens(1000, 1000, 1, 2) == Lens(1000, 1000, 1, 2)
    assert Lens(1000, 1000, 1, 2) != Lens(1000, 1000, 1, 3)
