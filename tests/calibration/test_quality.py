"""The figures of quality, against boards whose flaws are known, and the verdict that rests on them."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.traced_boards import PRISM_RIGS, SQUARE_MM, traced_detection
from prismstereo_calibration.board import Board
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.detection import Detection, Sighting
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.quality import Criterion, judge, triangulate
from prismstereo_calibration.solve import solve
from prismstereo_calibration.summary import summary
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig

Array = NDArray[np.float64]
BOARD = Board(9, 7, SQUARE_MM)


@pytest.fixture(params=PRISM_RIGS)
def nominal(request: pytest.FixtureRequest) -> Calibration:
    """What each built-in prism rig promises."""
    return Calibration.nominal(Rig.read(request.param))


def boards_before(calibration: Calibration, points: Array | None = None) -> Detection:
    """Five boards, 400 to 600 mm away, exactly as the calibration's own pinholes see them."""
    points = BOARD.points() if points is None else points
    pairs = []
    for index, (tilt, z_mm) in enumerate([(0.0, 400.0), (0.4, 450.0), (-0.4, 500.0), (0.2, 550.0), (-0.1, 600.0)]):
        c, s = math.cos(tilt), math.sin(tilt)
        R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        middle = calibration.right.centre / 2 + np.array([-0.05 * z_mm, 0, z_mm])
        in_left = (points - points.mean(axis=0)) @ R.T + middle
        pairs.append(Sighting.of(f"{index}.png", calibration.left.project(in_left), calibration.right.project(in_left)))
    return Detection(calibration.frame_width, calibration.frame_height, calibration.views, tuple(pairs))


def moved(detection: Detection, dy_px: float) -> Detection:
    """The detection with the right view's corners moved down."""
    pairs = (Sighting.of(p.name, p.left, p.right + np.array([0.0, dy_px])) for p in detection.sightings)
    return replace(detection, sightings=tuple(pairs))


def test_exact_corners_have_no_gap_lie_in_a_plane_and_are_as_long_as_they_are(nominal: Calibration) -> None:
    quality = judge(nominal, boards_before(nominal), BOARD)
    assert quality.triangulation_gap.mean < 1e-9
    assert quality.plane_fit.rms < 1e-8
    assert quality.row_error.p95_px < 1e-8
    assert abs(quality.scale_error.rms) < 1e-10
    assert quality.verdict == "good"
    assert quality.unit == "mm"


def test_triangulated_points_are_where_they_were(nominal: Calibration) -> None:
    points = np.array([[-30.0, 5.0, 400.0], [10.0, -20.0, 700.0]])
    found, gap = triangulate(nominal, nominal.left.project(points), nominal.right.project(points))
    np.testing.assert_allclose(found, points, atol=1e-8)
    assert gap.max() < 1e-9


def test_a_view_that_crept_down_by_a_pixel_has_a_row_error_of_a_pixel(nominal: Calibration) -> None:
    quality = judge(nominal, moved(boards_before(nominal), 1.0), BOARD)
    assert 0.85 < quality.row_error.mean_px < 1.05  # less where the views look outwards and are turned back
    assert quality.verdict == "redo"
    assert quality.triangulation_gap.mean == pytest.approx(480 / nominal.left.lens.fx_px, rel=0.3)  # z / f


def test_half_a_pixel_of_row_error_is_usable_and_no_more(nominal: Calibration) -> None:
    assert judge(nominal, moved(boards_before(nominal), 0.55), BOARD).verdict == "usable"


def test_a_bowed_board_shows_in_the_plane_fit_alone(nominal: Calibration) -> None:
    bowed = BOARD.points()
    bowed[:, 2] = 0.5 * np.where(np.arange(63) % 2 == 0, 1.0, -1.0)  # every other corner half a millimetre up or down
    quality = judge(nominal, boards_before(nominal, bowed), BOARD)
    assert quality.plane_fit.rms == pytest.approx(0.5, rel=0.02)
    assert quality.plane_fit.mean == pytest.approx(0.5, rel=0.02)
    assert quality.plane_fit.variance < 0.01
    assert quality.triangulation_gap.mean < 1e-9


def test_a_board_one_per_cent_larger_than_said_is_one_per_cent_too_long(nominal: Calibration) -> None:
    quality = judge(nominal, boards_before(nominal, 1.01 * BOARD.points()), BOARD)
    assert quality.scale_error.mean == pytest.approx(0.01, abs=1e-9)
    assert judge(nominal, boards_before(nominal, 0.98 * BOARD.points()), BOARD).verdict == "redo"


def test_noise_gives_the_gap_and_the_plane_that_the_reference_predicts() -> None:
    """Mean gap 1.128 s Z / f, mean depth error 1.128 s Z^2 / (f B) (optics, noise floor), both half-normal.

    The distance from a tilted board's plane is the depth error times the cosine of the tilt.
    """
    rig = Rig.read("dslr-35mm")
    solution = solve(traced_detection(rig, 0, poses=30), BOARD, rig=rig)
    quality = judge(solution.calibration, traced_detection(rig, 0, poses=30), BOARD)
    middle = solution.t_left_from_board + solution.R_left_from_board @ BOARD.points().mean(axis=0)
    z, cosine = middle[:, 2], solution.R_left_from_board[:, 2, 2]
    focal, baseline = solution.calibration.left.lens.fx_px, solution.calibration.baseline
    gap, plane = quality.triangulation_gap, quality.plane_fit
    assert gap.mean == pytest.approx(1.128 * 0.2 * z.mean() / focal, rel=0.08)
    assert plane.mean == pytest.approx(1.128 * 0.2 * np.mean(z**2 * cosine) / (focal * baseline), rel=0.1)
    assert gap.variance / gap.mean**2 == pytest.approx(math.pi / 2 - 1, rel=0.15)


def test_rows_and_gaps_do_not_depend_on_which_camera_counts_as_left(oak: Rig) -> None:
    """The gap is a length in space: the same in the right camera's frame."""
    calibration = Calibration.nominal(oak)
    detection = traced_detection(oak, 4)
    pixels = detection.pixels()
    _, gap = triangulate(calibration, pixels[:, 0], pixels[:, 1])
    R, t = calibration.right.R_camera_from_left, calibration.right.t_camera_from_left
    a, b = Camera.at_origin(calibration.right.lens), Camera(calibration.left.lens, R.T, -R.T @ t)
    one, other = a.rays(pixels[:, 1]), b.rays(pixels[:, 0])
    normal = np.cross(one, other)
    across = np.abs(np.sum(normal * b.centre, axis=-1)) / np.linalg.norm(normal, axis=-1)
    np.testing.assert_allclose(gap, across, atol=1e-9)


def test_frames_that_are_not_the_calibrations_own_are_refused(oak: Rig) -> None:
    calibration, detection = Calibration.nominal(oak), traced_detection(oak, 1)
    with pytest.raises(CalibrationError, match="640x480"):
        judge(calibration, replace(detection, frame_width=640, frame_height=480), BOARD)
    with pytest.raises(CalibrationError, match="no frame with the board"):
        judge(calibration, replace(detection, sightings=()), BOARD)
    with pytest.raises(UsageError, match="--square-mm"):
        judge(calibration, detection, Board(9, 7))


@pytest.mark.parametrize(
    ("value", "band"), [(0.0, "good"), (0.4, "good"), (0.41, "usable"), (0.8, "usable"), (0.81, "redo")]
)
def test_a_figure_falls_in_one_of_three_bands(value: float, band: str) -> None:
    assert Criterion("mean row error", value, 0.4, 0.8, "px").band == band
    assert Criterion("mean row error", math.nan, 0.4, 0.8, "px").band == "redo"


@pytest.mark.parametrize("square_mm", [SQUARE_MM, None])
def test_the_summary_says_lengths_in_the_unit_that_they_have(oak: Rig, square_mm: float | None) -> None:
    board = Board(9, 7, square_mm)
    detection = traced_detection(oak, 1)
    solution = solve(detection, board, rig=oak)
    account = summary(solution, judge(solution.calibration, detection, board, rms_px=solution.rms_px))
    kept, null, suffix = (
        ("baseline_mm", "baseline_squares", "mm") if square_mm else ("baseline_squares", "baseline_mm", "squares")
    )
    assert account[kept] == solution.calibration.baseline
    assert account[null] is None
    assert {"rms_px", "views_used", "views_rejected", "focal_px", "principal_point_px", "distortion"} <= account.keys()
    assert {f"triangulation_gap_{suffix}", f"plane_fit_{suffix}", "row_error_px", "verdict", "model"} <= account.keys()
    assert account["verdict"] == "good"
    assert json.loads(json.dumps(account)) == account
