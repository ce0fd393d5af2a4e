"""Rectification without a board: what matches alone tell, measured on points and scenes with known cameras."""

from __future__ import annotations

from dataclasses import replace

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibration.scene_points import FOCAL_PX, HEIGHT, WIDTH, prism_halves, seen, shown, turn
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_calibration.uncalibrated.damped import Bounds, minimise
from prismstereo_calibration.uncalibrated.epipolar import row_errors
from prismstereo_calibration.uncalibrated.pictures import ViewPictures
from prismstereo_calibration.uncalibrated.registration import registered
from prismstereo_calibration.uncalibrated.scene_fit import fit_scene
from prismstereo_calibration.uncalibrated.scene_matches import SceneMatches, scene_matches
from prismstereo_calibration.uncalibrated.turned_views import TurnedForm, TurnedViews, fit_turned_views
from prismstereo_hw.errors import ImageError
from prismstereo_hw.kinds import AnyRig
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import named
from prismstereo_hw.twin import Twin
from prismstereo_hw.view import View, layout

Array = NDArray[np.float64]


def pictures(*, one_lens: bool) -> ViewPictures:
    return ViewPictures.of(layout("side-by-side"), 2 * WIDTH, HEIGHT, one_lens=one_lens)


def held_back_px(
    matches: SceneMatches, form: TurnedForm, *, one_lens: bool, focal_px: float | None = None
) -> tuple[float, TurnedViews]:
    """Mean row error of the half of the matches that the form was not fitted to, and the fit."""
    half = len(matches.left) // 2
    found = fit_turned_views(form, matches.left[:half], matches.right[:half], pictures(one_lens=one_lens), focal_px)
    errors = row_errors(found.H_left, found.H_right, matches.left[half:], matches.right[half:])
    return float(np.abs(errors).mean()), found


@pytest.mark.parametrize(("one_lens", "expected_px"), [(False, 0.338), (True, 0.330)])
def test_six_numbers_rectify_prism_halves_down_to_their_noise(one_lens: bool, expected_px: float) -> None:
    found = [held_back_px(prism_halves(seed), "quasi-euclidean-6", one_lens=one_lens) for seed in range(3)]
    assert np.mean([error for error, _ in found]) == pytest.approx(expected_px, rel=0.05)
    if one_lens:  # the axis where it is, at the seam, brings out the true focal length
        assert [turned.focal_px for _, turned in found] == pytest.approx([FOCAL_PX] * 3, rel=0.05)


def test_with_the_focal_length_known_five_angles_do_as_well() -> None:
    error, found = held_back_px(prism_halves(0), "quasi-euclidean-5", one_lens=True, focal_px=FOCAL_PX)
    assert error == pytest.approx(0.336, rel=0.05)
    assert found.focal_px == FOCAL_PX
    vergence_deg = found.angles_deg[0] - found.angles_deg[3]
    assert vergence_deg == pytest.approx(21.4, abs=0.3)


def parallel_views() -> SceneMatches:
    """Two cameras side by side that look the same way."""
    random = np.random.default_rng(4)
    points = np.stack([random.uniform(*ends, 600) for ends in ((-200, 200), (-200, 200), (600, 1100))], axis=1)
    middle = (np.array([WIDTH, HEIGHT]) - 1) / 2
    left, right = (seen(points, np.eye(3), np.array([x, 0.0, 0.0]), FOCAL_PX, middle) for x in (-24.0, 24.0))
    return shown(left, right, random, 0.3)


def test_cameras_that_look_the_same_way_do_not_tell_their_focal_length_and_get_an_ordinary_one() -> None:
    _, found = held_back_px(parallel_views(), "quasi-euclidean-6", one_lens=False)
    assert found.focal_px == pytest.approx(WIDTH / 2 / np.tan(np.radians(34)))
    np.testing.assert_allclose(found.angles_deg, 0, atol=0.5)


def two_lenses(seed: int) -> SceneMatches:
    """Two cameras side by side; the right lens is longer by a twentieth, and its axis 20 pixels low."""
    random = np.random.default_rng(seed)
    points = np.stack([random.uniform(*ends, 900) for ends in ((-200, 200), (-200, 200), (600, 1500))], axis=1)
    middle = (np.array([WIDTH, HEIGHT]) - 1) / 2
    left = seen(points, turn(0.5, 2.0, 1.0), np.array([-24.0, 0, 0]), 900.0, middle)
    right = seen(points, turn(-0.5, -2.0, 0.0), np.array([24.0, 0, 0]), 945.0, middle + np.array([0, 20]))
    return shown(left, right, random, 0.3)


def test_two_lenses_of_their_own_need_eight_numbers_and_get_them() -> None:
    made = fit_scene(two_lenses(1))
    by_form = {one.form: one for one in made.figures}
    assert made.form == "quasi-euclidean-8"
    assert by_form["quasi-euclidean-6"].row_error_mean_px > 1.0
    assert made.chosen.row_error_mean_px == pytest.approx(0.34, rel=0.1)  # the noise: 0.3 px, twice
    assert made.chosen.row_error_mean_px <= 1.02 * by_form["hartley"].row_error_mean_px
    assert made.chosen.skew_deg < min(0.3, by_form["hartley"].skew_deg)


def test_the_matches_lie_within_the_search_and_on_their_rows() -> None:
    matches = prism_halves(2)
    made = fit_scene(matches, one_lens=True)
    left, right = made.rectify(matches.left, made.left), made.rectify(matches.right, made.right)
    disparity = left[:, 0] - right[:, 0]
    assert made.form == "quasi-euclidean-6"
    assert 1 <= disparity.min() < disparity.max() <= made.window.labels - 2
    assert np.abs(left - right)[:, 1].mean() == pytest.approx(0.33, rel=0.1)


def test_a_search_too_long_makes_the_pictures_smaller() -> None:
    whole, small = fit_scene(prism_halves(2), one_lens=True), fit_scene(prism_halves(2), one_lens=True, most_labels=64)
    assert (whole.scale, whole.width) == (1.0, WIDTH)
    assert small.window.labels == 64
    assert small.width == round(small.scale * WIDTH) < WIDTH


def test_the_map_to_raw_pixels_is_the_inverse_of_the_way_from_them() -> None:
    made = fit_scene(prism_halves(1), one_lens=True)
    for side, corner in ((made.left, 0), (made.right, WIDTH)):
        sources = made.sources(side)
        rows, columns = np.nonzero(np.isfinite(sources[..., 0]))
        assert len(rows) > 0.5 * made.width * made.height
        again = made.rectify(sources[rows, columns] + np.array([corner, 0.0]), side)
        np.testing.assert_allclose(again, np.stack([columns, rows], axis=1), atol=1e-2)


def test_a_pattern_that_repeats_does_not_widen_the_search() -> None:
    matches = parallel_views()
    repeated = matches.left[:30] - [400.0, 0.0]  # next repeat of a wallpaper: on its row, and wrong
    with_repeats = replace(
        matches,
        left=np.concatenate([matches.left, repeated]),
        right=np.concatenate([matches.right, matches.right[:30]]),
    )
    assert fit_scene(with_repeats).window.labels <= fit_scene(matches).window.labels + 16


def test_too_few_matches_are_refused() -> None:
    matches = prism_halves(1)
    with pytest.raises(CalibrationError, match="31 matches, and 32 are needed"):
        fit_scene(replace(matches, left=matches.left[:31], right=matches.right[:31]))


def test_the_lens_axis_of_a_mirrored_view_is_that_of_the_whole_frame_mirrored() -> None:
    views = layout("side-by-side")[0], View(left=0.6, top=0.0, width=0.4, height=1.0, mirrored=True)
    placed = ViewPictures.of(views, 1000, 500)
    assert placed.one_lens
    np.testing.assert_allclose(placed.principal_points, [[499.5, 249.5], [1099.5, 249.5]])
    known = ViewPictures.of(views, 1000, 500, Lens(700.0, 700.0, 510.0, 240.0))
    np.testing.assert_allclose(known.principal_points, [[510.0, 240.0], [1089.0, 240.0]])
    apart = ViewPictures.of(layout("side-by-side"), 1000, 500)
    np.testing.assert_allclose(apart.principal_points, [[249.5, 249.5], [749.5, 249.5]])


def test_the_least_squares_find_what_scipy_finds() -> None:
    random = np.random.default_rng(5)
    x = np.linspace(0, 4, 80)
    y = 2.0 * np.exp(-0.7 * x) + random.normal(0, 0.05, 80)
    y[::9] += 3.0  # wrong ones, which soft-L1 bears

    def residuals(q: Array) -> Array:
        return np.asarray(q[0] * np.exp(-q[1] * x) - y)

    for high in (np.array([9.0, 9.0]), np.array([9.0, 0.5])):  # the second one stops at its bound
        mine = minimise(residuals, np.array([1.0, 0.1]), np.full(80, 0.1), Bounds(-high, high))
        theirs = least_squares(residuals, [1.0, 0.1], loss="soft_l1", f_scale=0.1, bounds=(-high, high), xtol=1e-12)
        np.testing.assert_allclose(mine.unknowns, theirs.x, atol=1e-4)
        assert mine.cost == pytest.approx(2 * theirs.cost, rel=1e-6)


@pytest.fixture(scope="module")
def desk_rig() -> AnyRig:
    oak = Rig.read("oak-1")
    return msgspec.structs.replace(
        oak, camera=msgspec.structs.replace(oak.camera, video=Mode(width=480, height=270, rate_hz=30.0))
    )


@pytest.fixture(scope="module")
def desk(desk_rig: AnyRig) -> NamedFrame:
    return NamedFrame("desk", Twin(desk_rig, named(desk_rig, "desk", 1)).frame().pixels)


@pytest.fixture(scope="module")
def expected(desk_rig: AnyRig) -> Rectification:
    return rectification(Calibration.nominal(desk_rig))


@pytest.fixture(scope="module")
def desk_matches(desk_rig: AnyRig, desk: NamedFrame, expected: Rectification) -> SceneMatches:
    return scene_matches([desk], desk_rig.views, expected)


def test_one_frame_of_a_desk_rectifies_a_prism_rig(
    desk_rig: AnyRig, desk_matches: SceneMatches, expected: Rectification
) -> None:
    matches = desk_matches
    made = fit_scene(matches, rig=desk_rig.name, lens=desk_rig.lens())
    assert made.form == "quasi-euclidean-5"
    assert made.chosen.row_error_mean_px <= 0.15
    # the exact optics agree: what the rig's own rectification puts on a row lies on a row here
    rows, columns = np.mgrid[15:255:15, 50:230:15]
    grid = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    pair = []
    for side, shift in ((expected.left, 0.0), (expected.right, -15.0)):
        sources = expected.sources(side)[grid[:, 1].astype(int), (grid[:, 0] + shift).astype(int)]
        x, y, _, _ = side.view.rectangle(480, 270)
        pair.append(sources + np.array([x, y], float))
    known = np.isfinite(pair[0]).all(axis=1) & np.isfinite(pair[1]).all(axis=1)
    off = made.rectify(pair[0], made.left)[known] - made.rectify(pair[1], made.right)[known]
    assert known.sum() > 100
    assert np.abs(off[:, 1]).mean() <= 0.3


def test_frames_that_show_nothing_are_named_and_the_others_count(
    desk_rig: AnyRig, desk: NamedFrame, desk_matches: SceneMatches, expected: Rectification
) -> None:
    wall = NamedFrame("wall", np.full_like(desk.pixels, 128))
    matches = scene_matches([wall, desk, desk], desk_rig.views, expected)
    assert [entry.name for entry in matches.rejected] == ["wall"]
    assert "the left view shows 0 points" in matches.rejected[0].reason
    assert len(matches.left) == len(desk_matches.left)  # what stands still is counted once
    with pytest.raises(ImageError, match="none of 1 frames can be used; wall: the left view shows 0 points"):
        scene_matches([wall], desk_rig.views)
    with pytest.raises(ImageError, match="small is 64x48, but the first frame 480x270"):
        scene_matches([wall, NamedFrame("small", np.zeros((48, 64), np.uint8))], desk_rig.views)
    with pytest.raises(ImageError, match="0 frames"):
        scene_matches([], desk_rig.views)


def test_a_match_is_set_right_to_a_twentieth_of_a_pixel_in_a_sheared_picture() -> None:
    random = np.random.default_rng(3)
    left = cv2.GaussianBlur(random.uniform(0, 255, (240, 320)).astype(np.float32), (0, 0), 2.0)
    left = np.clip(128 + 4 * (left - left.mean()), 0, 255).astype(np.uint8)
    warp = np.array([[0.92, 0.03, 11.3], [-0.02, 1.0, 4.7]])  # right pixels of left ones
    right = np.asarray(cv2.warpAffine(left, warp, (320, 240), flags=cv2.INTER_CUBIC), np.uint8)
    points = np.stack(np.meshgrid(np.arange(80.0, 260, 30), np.arange(60.0, 190, 30)), axis=-1).reshape(-1, 2)
    true = points @ warp[:, :2].T + warp[:, 2]
    a, b = registered(left, right, points, true + random.uniform(-1.5, 1.5, true.shape), reach_px=4.0)
    assert len(a) >= 0.9 * len(points)
    expected = a @ warp[:, :2].T + warp[:, 2]
    assert np.hypot(*(b - expected).T).mean() <= 0.05
