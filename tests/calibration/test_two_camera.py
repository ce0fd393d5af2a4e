"""The two-camera model: the optimum of `cv2.stereoCalibrate`, in any layout and any attitude of the views."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.traced_boards import SQUARE_MM, flawed, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Sighting
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.solving.solve import solve
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import LAYOUTS, View, layout

BOARD = Board(9, 7, SQUARE_MM)
Array = NDArray[np.float64]


def seen_by(left: Camera, right: Camera, views: tuple[View, View], seed: int, *, noise_px: float = 0.2) -> Detection:
    """Corner pairs of 14 boards before two cameras of a 1280x720 frame, upright pixels."""
    random = np.random.default_rng(seed)
    pairs = []
    for index in range(14):
        R, _ = cv2.Rodrigues(random.uniform(-0.5, 0.5, 3))
        middle = np.array([*random.uniform(-30, 30, 2), random.uniform(350, 550)])
        points = (BOARD.points() - BOARD.points().mean(axis=0)) @ np.asarray(R).T + middle
        pixels = [camera.project(points) + random.normal(0, noise_px, (63, 2)) for camera in (left, right)]
        pairs.append(Sighting.of(f"{index}.png", pixels[0], pixels[1]))
    return Detection(1280, 720, views, tuple(pairs))


def two_cameras(views: tuple[View, View]) -> tuple[Camera, Camera]:
    """Two unlike lenses, each about the middle of its view, 60 mm and a small turn apart."""
    middles = []
    for view in views:
        x, y, _, _ = view.rectangle(1280, 720)
        w, h = view.upright_size(1280, 720)
        middles.append((x + w / 2, y + h / 2))
    R, _ = cv2.Rodrigues(np.array([0.01, 0.05, -0.02]))
    (lx, ly), (rx, ry) = middles
    left = Camera.at_origin(Lens(900.0, 904.0, lx + 6, ly - 5, (-0.1, 0.05, 1e-3, -1e-3, 0.0)))
    right = Camera(
        Lens(880.0, 879.0, rx - 8, ry + 3, (-0.12, 0.07, 0.0, 1e-3, 0.0)),
        np.asarray(R),
        np.asarray(R) @ np.array([-60.0, 1.0, 2.0]),
    )
    return left, right


@pytest.mark.parametrize("name", ["oak-1", "dslr-35mm"])
def test_the_optimum_is_that_of_opencv(name: str) -> None:
    detection = traced_detection(flawed(Rig.read(name), (5.0, -3.0), (-0.06, 0.03)), 4)
    solution = solve(detection, BOARD, model="two-camera")
    left, right = solution.calibration.left, solution.calibration.right
    pixels = detection.pixels().astype(np.float32)
    rms, _, _, _, _, _, t, *_ = cv2.stereoCalibrate(
        [BOARD.points().astype(np.float32)] * len(pixels), list(pixels[:, 0]), list(pixels[:, 1]),
        left.lens.K, np.array(left.lens.distortion), right.lens.K, np.array(right.lens.distortion), (1280, 720),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
    )  # fmt: skip
    assert solution.rms_px == pytest.approx(rms, abs=1e-5)  # started at our optimum, OpenCV finds no better one
    assert solution.calibration.baseline == pytest.approx(float(np.linalg.norm(t)), abs=1e-3)


@pytest.mark.parametrize("name", LAYOUTS)
def test_any_layout_gives_its_cameras_in_full_frame_pixels(name: str) -> None:
    left, right = two_cameras(layout(name))
    solution = solve(seen_by(left, right, layout(name), 5), BOARD)
    found = solution.calibration
    assert found.model == "two-camera"
    assert found.rig == name
    assert found.baseline == pytest.approx(math.hypot(60, 1, 2), abs=0.15)
    for camera, true in ((found.left, left), (found.right, right)):
        assert camera.lens.fx_px == pytest.approx(true.lens.fx_px, rel=5e-3)
        assert camera.lens.cx_px == pytest.approx(true.lens.cx_px, abs=6)
        assert camera.lens.cy_px == pytest.approx(true.lens.cy_px, abs=6)
    assert solution.rms_px == pytest.approx(0.28, abs=0.015)


def test_corners_without_noise_give_the_cameras_exactly() -> None:
    views = layout("side-by-side")
    left, right = two_cameras(views)
    found = solve(seen_by(left, right, views, 6, noise_px=0.0), BOARD).calibration
    np.testing.assert_allclose(found.right.t_camera_from_left, right.t_camera_from_left, atol=1e-6)
    np.testing.assert_allclose(found.right.R_camera_from_left, right.R_camera_from_left, atol=1e-8)
    for camera, true in ((found.left, left), (found.right, right)):
        np.testing.assert_allclose(camera.lens.K, true.lens.K, atol=1e-4)
        np.testing.assert_allclose(camera.lens.distortion, true.lens.distortion, atol=1e-5)


@pytest.mark.parametrize("turn_deg", [0, 90, 180, 270])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_view_that_stands_otherwise_in_the_frame_gives_the_same_cameras(turn_deg: int, *, mirrored: bool) -> None:
    """The sensor's pixels are flipped and turned; upright, they are what they were."""
    left_view, right_view = (
        View(left=0.0, top=0.0, width=0.5, height=1.0),
        View(left=0.5, top=0.0, width=0.5, height=1.0),
    )
    otherwise = View(left=0.5, top=0.0, width=0.5, height=1.0, mirrored=mirrored, turn_deg=turn_deg)  # type: ignore[arg-type]
    left, right = two_cameras((left_view, right_view))
    detection = seen_by(left, right, (left_view, right_view), 7)
    raw = [otherwise.raw_from_upright(pair.right, 1280, 720) for pair in detection.sightings]
    upright = [otherwise.upright_from_raw(pixels, 1280, 720) for pixels in raw]
    flipped = Detection(
        1280, 720, (left_view, otherwise),
        tuple(Sighting.of(p.name, p.left, u) for p, u in zip(detection.sightings, upright, strict=True)),
    )  # fmt: skip
    plain, other = solve(detection, BOARD).calibration, solve(flipped, BOARD).calibration
    assert other.baseline == pytest.approx(plain.baseline, rel=1e-6)
    np.testing.assert_allclose(other.right.lens.K, plain.right.lens.K, rtol=1e-5)


def test_three_poses_are_enough_and_two_are_not(oak: Rig) -> None:
    detection = traced_detection(oak, 1, poses=3)
    assert solve(detection, BOARD, model="two-camera").calibration.baseline == pytest.approx(50.2, abs=1.5)
    with pytest.raises(CalibrationError, match="the two-camera model needs 3"):
        solve(replace(detection, sightings=detection.sightings[:2]), BOARD, model="two-camera")


def test_boards_that_only_face_the_camera_are_refused_with_the_mend(oak: Rig) -> None:
    with pytest.raises(CalibrationError, match="tilt"):
        solve(traced_detection(oak, 1, tilt_deg=0.5), BOARD, rig=oak, model="two-camera")


def test_exchanged_views_are_said_to_be_exchanged(oak: Rig) -> None:
    detection = traced_detection(oak, 1)
    exchanged = tuple(Sighting.of(pair.name, pair.right, pair.left) for pair in detection.sightings)
    with pytest.raises(CalibrationError, match="left and right are exchanged"):
        solve(replace(detection, sightings=exchanged, views=detection.views[::-1]), BOARD, model="two-camera")


def test_the_same_pictures_for_both_views_are_no_pair() -> None:
    seen = seen_by(*two_cameras(layout("side-by-side")), layout("side-by-side"), 5)
    alike = tuple(Sighting.of(one.name, one.left, one.left) for one in seen.sightings)
    with pytest.raises(CalibrationError, match="the two views stand in one place"):
        solve(replace(seen, sightings=alike), BOARD)
