"""The figures of quality, against boards whose flaws are known, and the verdict that rests on them."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.traced_boards import PRISM_RIGS, SQUARE_MM, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Sighting
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.judging.quality import Criterion, Floor, judge
from prismstereo_calibration.judging.summary import summary
from prismstereo_calibration.judging.triangulation import meet, triangulate
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.solve import solve
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
    assert quality.row_error.p95_px < 0.2  # what the best pinholes leave of the glass; measured 0.09 to 0.15
    assert abs(quality.scale_error.rms) < 1e-10
    assert quality.verdict == "good"
    assert quality.unit == "mm"


def test_without_glass_exact_corners_are_on_one_row(oak: Rig) -> None:
    pinholes = Calibration.nominal(oak).pinholes()
    assert judge(pinholes, boards_before(pinholes), BOARD).row_error.p95_px < 1e-8


def test_corners_that_one_view_does_not_show_are_left_out(oak: Rig) -> None:
    calibration = Calibration.nominal(oak)
    whole = boards_before(calibration)
    pixels = whole.pixels()
    pixels[0, 0, :40] = pixels[1, 1, 20:] = np.nan  # 23 and 20 corners are left
    pixels[2, 0, 2:] = np.nan  # two: no plane, no scale
    torn = replace(whole, sightings=tuple(Sighting(str(i), one) for i, one in enumerate(pixels)))
    quality = judge(calibration, torn, BOARD)
    assert quality.views == 5
    assert quality.row_error.all_px.size == 23 + 20 + 2 + 63 + 63
    assert quality.plane_fit.rms < 1e-8
    assert abs(quality.scale_error.rms) < 1e-10
    pixels[:, 0] = np.nan
    gone = replace(whole, sightings=tuple(Sighting(str(i), one) for i, one in enumerate(pixels)))
    with pytest.raises(CalibrationError, match="no frame shows 4 corners of the board in both views"):
        judge(calibration, gone, BOARD)


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


def test_a_corner_that_the_solution_rejected_does_not_count(oak: Rig) -> None:
    detection = traced_detection(oak, 1)
    pixels = detection.pixels()
    pixels[3, 1, 30] += [0.0, 25.0]  # a reflex on the glass, taken for a corner
    names = [one.name for one in detection.sightings]
    spoilt = replace(detection, sightings=tuple(Sighting(name, one) for name, one in zip(names, pixels, strict=True)))
    solution = solve(spoilt, BOARD, rig=oak)
    assert [(one.name, one.view, one.corner) for one in solution.rejected_corners] == [("pose03.png", 1, 30)]
    assert np.abs(judge(solution.calibration, spoilt, BOARD, solution=solution).row_error.all_px).max() < 1.5
    assert np.abs(judge(solution.calibration, spoilt, BOARD).row_error.all_px).max() > 20


def test_a_bowed_board_shows_in_the_plane_fit_alone(nominal: Calibration) -> None:
    bowed = BOARD.points()
    bowed[:, 2] = 0.5 * np.where(np.arange(63) % 2 == 0, 1.0, -1.0)  # every other corner half a millimetre up or down
    quality = judge(nominal, boards_before(nominal, bowed), BOARD)
    assert quality.plane_fit.rms == pytest.approx(
        0.5, rel=0.04
    )  # the plane of nine tenths of the corners is a little tilted
    assert quality.plane_fit.mean == pytest.approx(0.5, rel=0.04)
    assert quality.plane_fit.inlier_mean <= quality.plane_fit.mean
    assert quality.plane_fit.variance < 0.02
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
    solution = solve(traced_detection(rig, 0), BOARD, rig=rig)
    quality = judge(solution.calibration, traced_detection(rig, 0), BOARD)
    middle = solution.t_left_from_board + solution.R_left_from_board @ BOARD.points().mean(axis=0)
    z, cosine = middle[:, 2], solution.R_left_from_board[:, 2, 2]
    focal, baseline = solution.calibration.left.lens.fx_px, solution.calibration.baseline
    gap, plane = quality.triangulation_gap, quality.plane_fit
    assert gap.mean == pytest.approx(1.128 * 0.2 * z.mean() / focal, rel=0.1)
    assert plane.mean == pytest.approx(1.128 * 0.2 * np.mean(z**2 * cosine) / (focal * baseline), rel=0.1)
    assert gap.variance / gap.mean**2 == pytest.approx(math.pi / 2 - 1, rel=0.15)


def measured_over_floor(rig: Rig, seed: int) -> tuple[float, float]:
    """Gap and plane fit on ten poses that the solver never saw, over the closed form at their mean depth."""
    fresh = traced_detection(rig, 100 + seed, poses=10)
    calibration = solve(traced_detection(rig, seed), BOARD, rig=rig).calibration
    quality = judge(calibration, fresh, BOARD)
    pixels = fresh.pixels()
    depth = triangulate(calibration, pixels[:, 0], pixels[:, 1])[0][..., 2].mean()
    floor = Floor.of(calibration, float(depth), 0.2)
    return quality.triangulation_gap.mean / floor.triangulation_gap, quality.plane_fit.mean / floor.plane_fit


def test_gap_and_plane_of_fresh_poses_are_those_of_the_noise_alone(oak: Rig) -> None:
    gap, plane = measured_over_floor(oak, 0)
    assert gap == pytest.approx(1.0, abs=0.14)
    assert plane == pytest.approx(1.0, abs=0.14)


@pytest.mark.soak
@pytest.mark.parametrize(("name", "within"), [("dslr-35mm", 0.06), ("oak-1", 0.14)])
def test_twenty_campaigns_reach_the_floor_of_table_one(name: str, within: float) -> None:
    rig = Rig.read(name)
    gap, plane = np.median([measured_over_floor(rig, seed) for seed in range(20)], axis=0)
    print(f"\n{name:14s} over the closed form, fresh poses, medians of 20: gap {gap:.3f}, plane fit {plane:.3f}")
    assert gap < 1 + within
    assert plane < 1 + within
    assert min(gap, plane) > 0.9  # the plane takes three freedoms, and a tilted board shows less of a depth error


def test_rows_and_gaps_do_not_depend_on_which_camera_counts_as_left(oak: Rig) -> None:
    """The gap is a length in space: the same with the rays exchanged."""
    calibration = Calibration.nominal(oak)
    pixels = traced_detection(oak, 4).pixels()
    middle, gap = triangulate(calibration, pixels[:, 0], pixels[:, 1])
    exchanged, again = meet(calibration.right.rays(pixels[:, 1]), calibration.left.rays(pixels[:, 0]))
    np.testing.assert_allclose(gap, again, atol=1e-9)
    np.testing.assert_allclose(middle, exchanged, atol=1e-9)
    assert 0.05 < gap.mean() < 0.5


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
    assert Criterion("coverage", -value, -0.4, -0.8, "of the cells", at_least=True).band == band


def test_three_views_of_a_corner_of_the_field_are_no_good_calibration(oak: Rig) -> None:
    """The corners fit as well as ever; what is not known, and where nobody looked, decides."""
    detection = traced_detection(oak, 1, poses=3)
    solution = solve(detection, BOARD, rig=oak)
    quality = judge(solution.calibration, detection, BOARD, solution=solution)
    bands = {one.name: one.band for one in quality.criteria}
    assert bands["reprojection rms"] == bands["mean row error"] == bands["scale error"] == "good"
    assert bands["views"] == bands["depth uncertainty"] == bands["coverage, left view"] == "usable"
    assert quality.verdict == "usable"
    assert judge(solution.calibration, detection, BOARD, rms_px=solution.rms_px).coverage == ()


def test_a_pixel_is_worth_its_share_of_the_depth_at_a_metre(oak: Rig) -> None:
    """A pixel of disparity is worth Z^2 / (f B), a pixel of a row Z / f, a share of the length that share of Z."""
    calibration = Calibration.nominal(oak)
    quality = judge(calibration, boards_before(calibration), BOARD, rms_px=0.3)
    worth = {one.name: one.length_per_unit for one in quality.criteria}
    f, b = calibration.focal_px, calibration.baseline
    assert quality.yardstick == 1000.0
    assert worth == {
        "reprojection rms": pytest.approx(1e6 / (f * b)),
        "mean row error": pytest.approx(1e3 / f),
        "scale error": pytest.approx(1e3),
    }


@pytest.mark.parametrize("square_mm", [SQUARE_MM, None])
def test_the_summary_says_lengths_in_the_unit_that_they_have(oak: Rig, square_mm: float | None) -> None:
    board = Board(9, 7, square_mm)
    detection = traced_detection(oak, 1)
    solution = solve(detection, board, rig=oak)
    account = summary(solution, judge(solution.calibration, detection, board, solution=solution))
    kept, null, suffix = (
        ("baseline_mm", "baseline_squares", "mm") if square_mm else ("baseline_squares", "baseline_mm", "squares")
    )
    assert account[kept] == solution.calibration.baseline
    assert account[null] is None
    assert {"rms_px", "views_used", "views_rejected", "focal_px", "principal_point_px", "distortion"} <= account.keys()
    assert {f"triangulation_gap_{suffix}", f"plane_fit_{suffix}", "row_error_px", "verdict", "model"} <= account.keys()
    assert {"views", "corners_rejected", "coverage", "depth_uncertainty", "assembly", "next_views"} <= account.keys()
    assert account["verdict"] == "good"
    assert json.loads(json.dumps(account)) == account
    wrong = "squares" if square_mm else "mm"
    assert f"_{wrong}" not in json.dumps(account).replace("baseline_squares", "").replace("baseline_mm", "")


def test_the_summary_tells_each_frame_and_half_by_its_own_rms(oak: Rig) -> None:
    detection = traced_detection(oak, 1)
    solution = solve(detection, BOARD, rig=oak)
    residuals = solution.residuals_px.copy()
    residuals[4, 1] *= 3.0
    residuals[5, 0, :60] = np.nan  # three corners are left
    residuals[6, 1] = np.nan
    account = summary(
        replace(solution, residuals_px=residuals), judge(solution.calibration, detection, BOARD, rms_px=0.3)
    )
    views = account["views"]
    assert isinstance(views, list)
    assert views[4]["rms_by_view_px"][1] == pytest.approx(
        3 * math.sqrt(np.mean(np.sum(solution.residuals_px[4, 1] ** 2, -1)))
    )
    assert views[5]["corners_by_view"] == [3, 63]
    assert views[6]["rms_by_view_px"][1] is None
    assert views[0]["file"] == "pose00.png"
