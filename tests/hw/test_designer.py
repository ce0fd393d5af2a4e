"""The designer: its rigs do what was wished for, no ray meets a part it should not, and what cannot be had is said."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from prismstereo_hw.catalogue import camera, cameras
from prismstereo_hw.design.box_numbers import overlap_share, window_for
from prismstereo_hw.design.designer import Design, baseline_reach_mm, design
from prismstereo_hw.design.limits import limits, widest_field_deg
from prismstereo_hw.design.sensitivity import sensitivities
from prismstereo_hw.design.tolerance import Tolerances, assembly
from prismstereo_hw.errors import RigError
from prismstereo_hw.optics.figures import common_width_mm, figures
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Camera, Mode, Rig
from prismstereo_hw.sketch.ray_paths import ray_paths

VIDEO = Mode(width=1280, height=720, rate_hz=30.0)

# the reference's table of valid rigs: field, pupil diameter and distance of the camera, glass, baseline, columns kept
TABLE = {
    "dslr-50": (35.34, 4.375, 25.0, "N-BK7", 49.6, 1.0),
    "dslr-75": (35.34, 4.375, 25.0, "N-BK7", 74.9, 1.0),
    "dslr-75-at-40-mm": (35.34, 4.375, 40.0, "N-BK7", 75.2, 1.0),
    "dslr-100-at-40-mm": (35.34, 4.375, 40.0, "N-BK7", 100.0, 1.0),
    "75-mm-lens": (17.0, 4.5, 25.0, "N-BK7", 49.6, 1.0),
    "oak-40": (68.8, 2.4, 6.0, "N-BK7", 40.3, 0.816),
    "oak-50": (68.8, 2.4, 6.0, "N-BK7", 50.2, 0.816),
    "oak-75": (68.8, 2.4, 6.0, "N-BK7", 75.4, 0.816),
    "oak-flint": (68.8, 2.4, 6.0, "1.62", 50.4, 1.0),
    "oak-narrow-lens": (35.0, 2.3, 10.0, "N-BK7", 49.9, 1.0),
    "pi-2": (62.2, 1.5, 5.0, "N-BK7", 50.2, 0.925),
    "pi-3": (66.0, 2.6, 5.0, "N-BK7", 50.1, 0.859),
    "12-mm-50": (23.4, 4.0, 20.0, "N-BK7", 50.1, 1.0),
    "12-mm-100": (23.4, 4.0, 20.0, "N-BK7", 100.1, 1.0),
    "16-mm-50": (17.65, 4.0, 22.0, "N-BK7", 50.0, 1.0),
    "16-mm-30": (17.65, 4.0, 22.0, "N-BK7", 30.0, 1.0),
}


def for_row(name: str) -> Design:
    field, pupil, distance, glass, baseline, _ = TABLE[name]
    wanted = Camera(name=name, hfov_deg=field, pupil_diameter_mm=pupil, video=VIDEO, still=VIDEO)
    far = math.inf if field > 18 else 3000.0  # the narrowest fields cannot have the whole depth in common
    return design(wanted, baseline, 500.0, far, glass=glass, pupil_to_prism_mm=distance)


def of_the_catalogue(name: str, baseline_mm: float = 50.0, **more: str) -> Design:
    entry = camera(name)
    return design(entry.camera, baseline_mm, 400.0, math.inf, pupil_to_prism_mm=entry.pupil_to_prism_mm, **more)


@pytest.fixture(scope="module", params=TABLE)
def row(request: pytest.FixtureRequest) -> tuple[str, Design]:
    return request.param, for_row(request.param)


@pytest.fixture(scope="module", params=cameras())
def designed(request: pytest.FixtureRequest) -> Design:
    """A rig of 50 mm from 0.4 m to infinity for every camera of the catalogue."""
    return of_the_catalogue(request.param)


def test_a_design_is_as_good_as_the_reference_row(row: tuple[str, Design]) -> None:
    name, made = row
    *_, baseline_mm, kept = TABLE[name]
    assert made.figures.baseline_mm == pytest.approx(baseline_mm, abs=0.1)
    assert made.figures.columns_kept >= kept - 0.002  # one column of 640 is 0.0016


def test_no_ray_of_a_design_meets_a_part_that_it_should_not(row: tuple[str, Design]) -> None:
    rig = row[1].rig
    mirrors, prism, base = rig.mirrors, rig.prism, rig.prism.pupil_to_prism_mm
    mu, half = math.radians(mirrors.angle_deg), prism.side_mm / 2
    near = np.array([mirrors.near_edge_mm, base + mirrors.offset_mm])
    far = near + mirrors.length_mm * np.array([math.cos(mu), math.sin(mu)])
    flip = np.array([-1.0, 1.0])
    left, right, apex = np.array([-half, base]), np.array([half, base]), np.array([0.0, base + prism.height_mm])
    glass = ((left, right), (left, apex), (right, apex))
    own, other = (near * flip, far * flip), (near, far)
    path = ray_paths(rig, "left", 65)
    for points, direction in zip(path.points_mm, path.direction, strict=True):
        out, hit = points[-2], points[-1]
        from_prism = (out + 1e-6 * (hit - out), hit)
        to_scene = (hit + 1e-6 * direction, hit + 5000 * direction)
        to_prism = (points[0], points[1] - 1e-6 * (points[1] - points[0]))
        assert not any(crosses(from_prism, part) for part in (*glass, other))
        assert not any(crosses(to_scene, part) for part in (*glass, own, other))
        assert not any(crosses(to_prism, part) for part in (own, other))


def crosses(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> bool:
    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(*a, b[0]) * side(*a, b[1]) < 0 and side(*b, a[0]) * side(*b, a[1]) < 0


def test_every_camera_of_the_catalogue_gets_its_rig(designed: Design) -> None:
    assert designed.figures.baseline_mm == pytest.approx(50, abs=0.1)
    assert {limit.kind for limit in designed.limits} <= {"total_reflection", "seam", "overlap", "viewpoint", "still"}
    assert Rig.parse(designed.rig.toml(), "a rig file") == designed.rig
    assert figures(designed.rig) == designed.figures
    assert designed.box.range_min_mm <= 400
    assert designed.box.range_max_mm == math.inf


def test_all_four_corners_of_the_video_come_through(designed: Design) -> None:
    assert not any(limit.kind == "vignetting" for limit in designed.limits)
    video_only = msgspec.structs.replace(
        designed.rig, camera=msgspec.structs.replace(designed.rig.camera, still=designed.rig.camera.video)
    )
    assert not any(limit.kind == "still" for limit in limits(video_only, designed.figures))


def test_a_narrow_lens_converges_and_a_wide_one_looks_nearly_parallel() -> None:
    narrow, wide = of_the_catalogue("aps-c-35mm").figures, of_the_catalogue("oak-1").figures

    def crossing_mm(baseline_mm: float, vergence_deg: float) -> float:
        return baseline_mm / 2 / math.tan(math.radians(vergence_deg / 2))

    assert 600 < crossing_mm(narrow.baseline_mm, narrow.vergence_deg) < 850
    assert crossing_mm(wide.baseline_mm, wide.vergence_deg) > 1500


def test_the_two_ends_of_a_range_share_the_width_that_a_narrow_lens_has() -> None:
    made = of_the_catalogue("imx273-12mm")
    near, far = overlap_share(made.rig, 400.0)[0], overlap_share(made.rig, math.inf)[0]
    assert near == pytest.approx(far, abs=0.02)  # the mirrors' angle is set in steps of 0.05 degrees


def test_half_of_the_width_is_common_where_the_overlap_begins(dslr: Rig) -> None:
    found = figures(dslr)
    depth_mm = found.overlap_from_mm - found.viewpoint_mm[1]  # the figures count from the entrance pupil
    share, width = overlap_share(dslr, depth_mm)
    assert share == pytest.approx(0.5, abs=0.01)
    assert width == pytest.approx(
        common_width_mm(dslr, found.overlap_from_mm), rel=0.005
    )  # whose viewpoint is not the paraxial one


def test_an_optical_axis_off_the_middle_shows_the_other_view_in_some_columns(dslr: Rig) -> None:
    off = msgspec.structs.replace(dslr, camera=msgspec.structs.replace(dslr.camera, principal_offset_px=(32.0, 0.0)))
    found = figures(off)
    (beyond,) = (limit for limit in limits(off, found) if limit.unit == "share" and limit.kind == "seam")
    assert beyond.value == pytest.approx(32 / 640, abs=0.002)
    assert "other view" in beyond.says


def test_short_mirrors_are_named_as_what_cuts_columns_off(dslr: Rig) -> None:
    short = msgspec.structs.replace(dslr, mirrors=msgspec.structs.replace(dslr.mirrors, length_mm=30.0))
    found = figures(short)
    (cut,) = (limit for limit in limits(short, found) if limit.kind == "vignetting")
    assert cut.value == pytest.approx(1 - found.columns_kept)
    assert "misses the left mirror" in cut.says


def test_dense_glass_keeps_the_columns_that_crown_glass_loses() -> None:
    assert of_the_catalogue("oak-1", glass="1.62").figures.columns_kept == 1.0
    crown = of_the_catalogue("oak-1")
    (dark,) = (limit for limit in crown.limits if limit.kind == "total_reflection")
    assert dark.value == pytest.approx(1 - crown.figures.columns_kept)
    assert "58.4 degrees" in dark.says
    assert "index 1.59" in dark.says


@pytest.mark.parametrize(
    ("index", "field_deg"), [(1.4585, 49.6), (1.4917, 54.6), (1.5168, 58.4), (1.586, 69.0), (1.62, 74.3)]
)
def test_total_reflection_ends_where_the_reference_says(index: float, field_deg: float) -> None:
    assert widest_field_deg(index) == pytest.approx(field_deg, abs=0.06)


def test_a_baseline_that_cannot_be_had_is_answered_with_those_that_can() -> None:
    entry = camera("oak-1")
    low, high = baseline_reach_mm(entry.camera, 400, math.inf, pupil_to_prism_mm=entry.pupil_to_prism_mm)
    assert low < 29 < 110 < high  # the reference's limits for a prism of one inch
    with pytest.raises(
        RigError, match=rf"baseline 200 mm cannot be had with .*: {math.ceil(low)}\.\.{math.floor(high)} mm can"
    ):
        of_the_catalogue("oak-1", 200.0)
    for baseline in (low + 0.5, high - 0.5):
        assert of_the_catalogue("oak-1", baseline).figures.baseline_mm == pytest.approx(baseline, abs=0.1)
    for baseline in (low - 1.0, high + 1.0):
        with pytest.raises(RigError, match="is nearest"):
            of_the_catalogue("oak-1", baseline)


@pytest.mark.parametrize("baseline_mm", [0.0, -3.0])
def test_a_baseline_of_nothing_is_refused(baseline_mm: float) -> None:
    with pytest.raises(RigError, match="cannot be had"):
        of_the_catalogue("oak-1", baseline_mm)


@pytest.mark.parametrize("baseline_mm", [math.nan, math.inf])
def test_a_baseline_that_is_no_number_is_refused(baseline_mm: float) -> None:
    with pytest.raises(RigError, match="give a number of millimetres"):
        of_the_catalogue("oak-1", baseline_mm)


def test_a_range_inside_of_the_rig_is_refused() -> None:
    entry = camera("oak-1")
    with pytest.raises(RigError, match="from 1 to 2 mm: begin the range farther away"):
        design(entry.camera, 50.0, 1.0, 2.0, pupil_to_prism_mm=entry.pupil_to_prism_mm)
    with pytest.raises(RigError, match="from 1 to 2 mm: begin the range farther away"):
        baseline_reach_mm(entry.camera, 1.0, 2.0, pupil_to_prism_mm=entry.pupil_to_prism_mm)


def test_a_range_too_near_for_the_baseline_is_answered_with_one_that_is_not() -> None:
    entry = camera("aps-c-50mm")
    with pytest.raises(RigError, match=r"from 80 to inf mm the two views .* begin the range at \d+ mm") as told:
        design(entry.camera, 60.0, 80.0, math.inf, pupil_to_prism_mm=entry.pupil_to_prism_mm)
    nearest = float(str(told.value).split("begin the range at ")[1].split(" mm")[0])
    made = design(entry.camera, 60.0, nearest, math.inf, pupil_to_prism_mm=entry.pupil_to_prism_mm)
    assert overlap_share(made.rig, nearest)[0] == pytest.approx(0.25, abs=0.07)
    assert overlap_share(made.rig, math.inf)[0] == pytest.approx(0.25, abs=0.07)


def test_too_few_labels_are_answered_with_the_nearest_range() -> None:
    entry = camera("oak-1")
    with pytest.raises(
        RigError, match=r"needs 144 disparity labels, but 64 are searched: begin at (\d+) mm or search 144"
    ) as told:
        design(entry.camera, 50.0, 350.0, math.inf, labels=64, pupil_to_prism_mm=entry.pupil_to_prism_mm)
    nearest = float(str(told.value).split("begin at ")[1].split(" mm")[0])
    made = design(entry.camera, 50.0, nearest, math.inf, labels=64, pupil_to_prism_mm=entry.pupil_to_prism_mm)
    assert made.rig.range.labels == 64


def test_of_near_end_far_end_and_labels_any_two_give_the_third() -> None:
    for near, far in ((400.0, math.inf), (300.0, 900.0), (1000.0, 8000.0)):
        wish = window_for(50_000.0, near, far)
        offset = (50_000.0 / far if math.isfinite(far) else 0.0) - 1
        assert 50_000.0 / (1 + offset) == far if math.isfinite(far) else offset == -1
        assert 50_000.0 / (wish.labels - 2 + offset) <= near
        assert 50_000.0 / (wish.labels - 18 + offset) > near / 1.05  # sixteen fewer would hardly do
        assert wish.labels % 16 == 0


def test_an_unknown_glass_and_a_prism_too_far_away_are_refused() -> None:
    entry = camera("oak-1")
    with pytest.raises(RigError, match="no glass 'jelly'"):
        of_the_catalogue("oak-1", glass="jelly")
    with pytest.raises(RigError, match="bring the prism nearer"):
        design(entry.camera, 50.0, 400.0, math.inf, pupil_to_prism_mm=80.0)


def test_the_baseline_answers_to_each_dimension_as_the_reference_says(dslr: Rig) -> None:
    found = sensitivities(dslr)
    assert found.mirror_angle_mm_per_deg == pytest.approx(3.22, abs=0.005)
    assert found.near_edge_mm_per_mm == pytest.approx(2.79, abs=0.005)
    assert found.offset_mm_per_mm == pytest.approx(-1.84, abs=0.005)
    assert found.pupil_to_prism_mm_per_mm == pytest.approx(-0.24, abs=0.005)
    assert found.prism_side_mm_per_mm == pytest.approx(1.46, abs=0.005)
    assert found.glass_index_mm_per_unit == pytest.approx(2.26, abs=0.005)


def test_a_mirror_that_all_but_touches_the_prism_has_the_same_sensitivities(dslr: Rig) -> None:
    near_edge_mm = 12.7 * (1 - 9.5 / dslr.prism.height_mm)  # where the prism's face is, at the height of that edge
    tight = msgspec.structs.replace(dslr.mirrors, near_edge_mm=near_edge_mm + 1e-6)
    found = sensitivities(msgspec.structs.replace(dslr, mirrors=tight))
    assert found.near_edge_mm_per_mm == pytest.approx(2.79, abs=0.005)
    assert found.prism_side_mm_per_mm == pytest.approx(1.46, abs=0.005)


def test_the_vergence_answers_to_the_mirrors_fourfold(rig: Rig) -> None:
    turned = msgspec.structs.replace(
        rig, mirrors=msgspec.structs.replace(rig.mirrors, angle_deg=rig.mirrors.angle_deg + 0.1)
    )
    change = (figures(turned).vergence_deg - figures(rig).vergence_deg) / 0.1
    assert change == pytest.approx(sensitivities(rig).vergence_deg_per_mirror_angle_deg, abs=1e-6)


def test_a_perfect_unit_has_only_the_error_of_the_glass(dslr: Rig) -> None:
    exact = Tolerances(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, creep_deg=0.0)
    found = assembly(dslr, exact, units=2)
    assert found.baseline_spread_mm == 0
    assert found.rows_apart_px < 0.05  # what no pinhole follows moves rows as well
    for other in (found.error_calibrated_mm, found.error_after_creep_mm):
        assert found.error_from_drawing_mm == pytest.approx(other, rel=1e-5)  # the index is written with nine digits
    assert found.error_calibrated_mm["500"] < 0.2


def test_calibration_absorbs_tilted_mirrors_but_not_what_creeps_later(dslr: Rig) -> None:
    found = assembly(dslr)
    perfect = assembly(dslr, Tolerances(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), units=1)
    assert found.error_from_drawing_mm["1000"] > 50
    assert found.error_calibrated_mm["1000"] == pytest.approx(perfect.error_calibrated_mm["1000"], abs=0.1)
    assert found.rows_apart_px > 5
    # the reference: 0.01 degrees of creep cost 1.75 mm at 0.5 m and 7 mm at 1 m with a baseline of 50 mm
    assert perfect.error_after_creep_mm["500"] == pytest.approx(1.75, abs=0.15)
    assert perfect.error_after_creep_mm["1000"] == pytest.approx(7.0, abs=0.35)


def test_an_error_of_the_drawing_is_what_its_angle_makes_of_the_disparity(dslr: Rig) -> None:
    # a mirror turned by 0.01 degrees turns its view by 0.02: the same error as a creep of that size
    found = assembly(dslr, Tolerances(0.01, 0.0, 0.0, 0.0, 0.0, 0.0), units=120)
    # two independent mirrors; the median of |N(0, s)| is 0.6745 s
    assert found.error_from_drawing_mm["1000"] == pytest.approx(0.6745 * math.sqrt(2) * 7.0, rel=0.2)


def test_the_same_seed_builds_the_same_units(oak: Rig) -> None:
    assert assembly(oak, units=5, seed=3) == assembly(oak, units=5, seed=3)
    assert assembly(oak, units=5, seed=3) != assembly(oak, units=5, seed=4)


def test_the_spread_of_the_baseline_is_what_the_sensitivities_say(dslr: Rig) -> None:
    only_position = Tolerances(0.0, 0.2, 0.0, 0.0, 0.0, 0.0)
    found, slopes = assembly(dslr, only_position, units=150), sensitivities(dslr)
    # each mirror gives half of the baseline, and both are placed on their own
    expected = 0.2 * math.hypot(slopes.near_edge_mm_per_mm, slopes.offset_mm_per_mm) / math.sqrt(2)
    assert found.baseline_spread_mm == pytest.approx(expected, rel=0.15)


def test_mirrors_that_touch_the_prism_cannot_be_built(dslr: Rig) -> None:
    tight = msgspec.structs.replace(dslr, mirrors=msgspec.structs.replace(dslr.mirrors, near_edge_mm=7.22))
    assert assembly(tight, Tolerances(mirror_position_mm=0.3), units=40).unbuildable > 5


def test_the_viewpoints_of_the_drawn_rays_are_those_of_the_optics(designed: Design) -> None:
    x, z = ray_paths(designed.rig, "left").viewpoint_mm
    centre = fold(designed.rig, "left").paraxial_centre_mm
    assert (x, z) == pytest.approx((centre[0], centre[2]), abs=1.5)
    assert -2 * x == pytest.approx(designed.figures.baseline_mm, abs=0.7)
