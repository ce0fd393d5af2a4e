"""The exact optics: the closed form against the ray tracer, its inverse, and the laws of the reference's section 2.

The tracer knows four plane surfaces and Snell's law and nothing of unfolding; the closed form knows a rigid motion and a
glass plate and nothing of surfaces. They agree to rounding.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_hw.optics.trace import Traced, view_fates
from prismstereo_hw.optics.unfold import FoldedView, fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

SIDES: tuple[Side, Side] = ("left", "right")
PIXEL_GRID = np.stack(np.meshgrid(np.linspace(0, 1279, 65), np.linspace(0, 719, 31)), axis=-1)


def changed(rig: Rig, **values: object) -> Rig:
    """The rig with some values of its prism, mirrors or camera replaced."""
    parts = {
        name: {key: value for key, value in values.items() if key in part.__struct_fields__}
        for name, part in (("prism", rig.prism), ("mirrors", rig.mirrors), ("camera", rig.camera))
    }
    return msgspec.structs.replace(
        rig, **{name: msgspec.structs.replace(getattr(rig, name), **change) for name, change in parts.items()}
    )


@st.composite
def rigs(draw: st.DrawFn) -> Rig:
    """Rigs of any size, glass and mirror angle, as well as one leaves a workshop: with both mirrors tipped."""
    side = draw(st.floats(10, 80))
    distance = draw(st.floats(2, 30))
    return changed(
        Rig.read("dslr-35mm"),
        hfov_deg=min(draw(st.floats(10, 60)), 0.95 * math.degrees(2 * math.atan(side / 2 / distance))),
        side_mm=side,
        pupil_to_prism_mm=distance,
        glass=str(draw(st.floats(1.4, 1.9))),
        angle_deg=draw(st.floats(50, 64)),
        near_edge_mm=draw(st.floats(0.51, 3)) * side,
        offset_mm=draw(st.floats(0, 1.5)) * side,
        left_tip_deg=draw(st.floats(-1, 1)),
        right_tip_deg=draw(st.floats(-1, 1)),
    )


def slopes_of(rig: Rig, side: Side) -> np.ndarray:
    """The slopes (N, 2) of the pixels of a grid over the frame that look through one side's mirror."""
    slopes = rig.lens().slopes(PIXEL_GRID).reshape(-1, 2)
    return slopes[slopes[:, 0] > 0] if side == "left" else slopes[slopes[:, 0] < 0]


def unstopped(traced: Traced) -> np.ndarray:
    """Rays (N,) whose directions are physical: total reflection and refraction held; misses of an edge do not matter."""
    bad = [index for index, fate in enumerate(traced.fates) if "reflected" in fate or "leave" in fate]
    return ~np.isin(traced.fate, bad)


def assert_same_rays(rig: Rig, side: Side) -> None:
    slopes = slopes_of(rig, side)
    traced = view_fates(rig, side, slopes)
    origin, direction = fold(rig, side).rays(slopes)
    good = unstopped(traced)
    assert good.any()
    np.testing.assert_allclose(direction[good], traced.direction[good], rtol=0, atol=1e-11)
    apart = np.linalg.norm(np.cross(traced.point_mm - origin, direction), axis=-1)
    assert apart[good].max() < 1e-9


@pytest.mark.parametrize("side", SIDES)
def test_the_closed_form_and_the_ray_tracer_agree_to_a_picometre(rig: Rig, side: Side) -> None:
    assert_same_rays(rig, side)


@given(rigs(), st.sampled_from(SIDES))
def test_they_agree_for_any_rig_with_tipped_mirrors(rig: Rig, side: Side) -> None:
    assert_same_rays(rig, side)


@given(rigs(), st.sampled_from(SIDES), st.floats(50, 1e6))
def test_a_point_on_a_pixels_ray_is_projected_to_that_pixel(rig: Rig, side: Side, reach_mm: float) -> None:
    view, slopes = fold(rig, side), slopes_of(rig, side)
    origin, direction = view.rays(slopes)
    points = origin + (reach_mm + rig.prism.height_mm) * direction
    pixels = rig.lens().project_slopes(view.slopes(points))
    np.testing.assert_allclose(pixels, rig.lens().project_slopes(slopes), rtol=0, atol=1e-7 if reach_mm > 1e4 else 1e-9)


def test_the_point_on_the_axis_is_projected_to_the_axis(rig: Rig) -> None:
    for side in SIDES:
        view = fold(rig, side)
        point = view.paraxial_centre_mm + 500.0 * view.R[2]
        np.testing.assert_allclose(view.slopes(point), 0.0, atol=1e-12)


def test_points_behind_the_glass_have_no_pixel(rig: Rig) -> None:
    view = fold(rig, "left")
    behind = view.paraxial_centre_mm - np.outer([0.0, 10.0, 1e5], view.R[2])
    assert np.isnan(view.slopes(behind)).all()


@given(rigs())
def test_two_reflections_leave_no_mirror_image(rig: Rig) -> None:
    for side in SIDES:
        R = fold(rig, side).R
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)


def test_each_half_keeps_the_order_of_left_and_right_and_of_up_and_down(rig: Rig) -> None:
    for side in SIDES:
        view = fold(rig, side)
        origin, direction = view.rays(np.array([[0.1, 0.0], [0.12, 0.0], [0.1, 0.02]]))
        at = origin + (1000 - origin[:, 2:]) / direction[:, 2:] * direction
        assert at[1, 0] > at[0, 0]
        assert at[2, 1] > at[0, 1]


def test_the_left_view_is_the_right_one_mirrored(rig: Rig) -> None:
    left, right = fold(rig, "left"), fold(rig, "right")
    flip = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(left.paraxial_centre_mm, flip * right.paraxial_centre_mm, atol=1e-12)
    points = np.array([[30.0, -20.0, 600.0], [-100.0, 5.0, 900.0]])
    np.testing.assert_allclose(left.slopes(points), [-1, 1] * right.slopes(points * flip), atol=1e-12)


def test_glass_bends_no_direction_so_colours_do_not_part(rig: Rig) -> None:
    blue, red = (changed(rig, glass=index) for index in ("1.52238", "1.51432"))  # N-BK7 at the F and C lines
    slopes = slopes_of(rig, "left")
    np.testing.assert_array_equal(fold(blue, "left").rays(slopes)[1], fold(red, "left").rays(slopes)[1])
    traced = [view_fates(one, "left", slopes) for one in (blue, red)]
    kept = (traced[0].fate == 0) & (traced[1].fate == 0)
    np.testing.assert_allclose(traced[0].direction[kept], traced[1].direction[kept], rtol=0, atol=1e-12)


def test_colours_only_shift_along_the_axis(dslr: Rig) -> None:
    # reference: 0.08 mm for a one-inch prism, lateral colour about 0.12 px at the outer edge at 0.4 m
    blue, red = (fold(changed(dslr, glass=index), "left") for index in ("1.52238", "1.51432"))
    assert blue.paraxial_shift_mm - red.paraxial_shift_mm == pytest.approx(0.077, abs=2e-3)
    start, direction = blue.rays(np.array([math.tan(math.radians(17.67)), 0.0]))
    point = start + 400.0 * direction
    apart = (blue.slopes(point) - red.slopes(point)) * dslr.lens().fx_px
    assert abs(apart[0]) == pytest.approx(0.12, abs=0.02)


def test_a_ray_leaves_at_twice_the_mirror_angle_less_120_degrees_plus_its_field_angle(rig: Rig) -> None:
    field_deg = np.array([0.0, 3.0, rig.camera.hfov_deg / 4])
    slopes = np.stack([np.tan(np.radians(field_deg)), np.zeros(3)], axis=-1)
    _, direction = fold(rig, "left").rays(slopes)
    inward_deg = np.degrees(np.arctan2(direction[:, 0], direction[:, 2]))
    np.testing.assert_allclose(inward_deg, 2 * rig.mirrors.angle_deg - 120 + field_deg, atol=1e-9)


def test_the_optical_axes_part_by_four_times_what_the_mirrors_lack_of_60_degrees(dslr: Rig, oak: Rig) -> None:
    for rig, parting_deg in ((dslr, 13.6), (oak, 27.2)):
        left, right = fold(rig, "left").R[2], fold(rig, "right").R[2]
        assert math.degrees(math.acos(left @ right)) == pytest.approx(parting_deg, abs=1e-6)
        assert left[0] < 0 < right[0]


def closed_form_centre(rig: Rig, delta: float) -> tuple[float, float]:
    """The right virtual camera by the closed form of the reference: x and z in the rig frame, mm."""
    prism, mirrors = rig.prism, rig.mirrors
    h, d, mu, s = prism.height_mm, prism.pupil_to_prism_mm, math.radians(mirrors.angle_deg), math.sin(math.radians(60))
    q = d + h - delta
    shared = math.sin(mu) * (q * s + mirrors.near_edge_mm) + math.cos(mu) * (delta + q / 2 - d - mirrors.offset_mm)
    return -q * s + 2 * math.sin(mu) * shared, delta + q / 2 - 2 * math.cos(mu) * shared


def upright(rig: Rig) -> Rig:
    """The rig with its mirrors as drawn, not tipped."""
    return changed(rig, left_tip_deg=0.0, right_tip_deg=0.0)


@given(rigs().map(upright))
def test_the_virtual_pinhole_is_where_the_closed_form_puts_it(rig: Rig) -> None:
    prism = rig.prism
    expected = closed_form_centre(rig, prism.height_mm * (1 - 1 / prism.index))
    centre = fold(rig, "right").paraxial_centre_mm
    np.testing.assert_allclose(centre, [expected[0], 0.0, expected[1]], rtol=0, atol=1e-9)


@given(rigs().map(upright), st.floats(1, 29))
def test_off_the_axis_the_plate_moves_the_pinhole_by_delta(rig: Rig, field_deg: float) -> None:
    t = math.radians(field_deg)
    delta = rig.prism.height_mm * (1 - math.cos(t) / math.sqrt(rig.prism.index**2 - math.sin(t) ** 2))
    # out of the symmetry plane the ray of field angle t passes the optical axis where the closed form says
    origin, _ = fold(rig, "right").rays(np.array([0.0, math.tan(t)]))
    x, z = closed_form_centre(rig, delta)
    np.testing.assert_allclose(origin, [x, 0.0, z], rtol=0, atol=1e-9)


@given(rigs().map(upright))
def test_at_60_degrees_the_baseline_depends_on_neither_pupil_nor_glass(rig: Rig) -> None:
    square = changed(rig, angle_deg=60.0)
    baseline = 2 * fold(square, "right").paraxial_centre_mm[0]
    expected = 3 * square.mirrors.near_edge_mm + math.sqrt(3) * (square.prism.height_mm - square.mirrors.offset_mm)
    assert baseline == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("field", "step", "slope"),
    [
        ("angle_deg", 1e-3, 3.22), ("near_edge_mm", 1e-3, 2.79), ("offset_mm", 1e-3, -1.84),
        ("pupil_to_prism_mm", 1e-3, -0.24), ("side_mm", 1e-3, 1.46), ("glass", 1e-4, 2.26),
    ],
)  # fmt: skip
def test_the_baseline_of_the_dslr_rig_changes_as_the_reference_says(
    dslr: Rig, field: str, step: float, slope: float
) -> None:
    def baseline(change: float) -> float:
        if field == "glass":
            rig = changed(dslr, glass=repr(dslr.prism.index + change))
        else:
            part = dslr.mirrors if field in dslr.mirrors.__struct_fields__ else dslr.prism
            rig = changed(dslr, **{field: getattr(part, field) + change})
        left, right = fold(rig, "left"), fold(rig, "right")
        return float(right.paraxial_centre_mm[0] - left.paraxial_centre_mm[0])

    assert (baseline(step) - baseline(-step)) / (2 * step) == pytest.approx(slope, abs=0.006)


def test_a_tipped_mirror_throws_its_view_up_and_leaves_the_other_alone(dslr: Rig) -> None:
    tipped = changed(dslr, left_tip_deg=0.3)
    _, before = fold(dslr, "left").rays(np.array([0.1, 0.0]))
    _, after = fold(tipped, "left").rays(np.array([0.1, 0.0]))
    incidence = abs(before @ dslr.surfaces("left")[-1].normal)
    assert abs(math.degrees(math.asin(after[1]))) == pytest.approx(2 * 0.3 * incidence, abs=1e-3)
    np.testing.assert_array_equal(fold(tipped, "right").R, fold(dslr, "right").R)
    assert tipped.surfaces("left")[-1].normal[1] == pytest.approx(math.sin(math.radians(0.3)))


@pytest.mark.parametrize(
    ("glass", "widest_deg"), [("fused silica", 49.6), ("PMMA", 54.6), ("N-BK7", 58.4), ("PC", 69.0), ("1.62", 74.3)]
)
def test_total_reflection_ends_at_the_field_that_the_index_allows(glass: str, widest_deg: float) -> None:
    # reference: 2 asin(n sin(60 - asin(1/n)))
    rig = changed(Rig.read("oak-1"), glass=glass, side_mm=50.8, near_edge_mm=30.0)

    def reflected(full_field_deg: float) -> bool:
        slopes = np.array([math.tan(math.radians(full_field_deg / 2)), 0.0])
        traced = view_fates(rig, "left", slopes)
        return "totally" not in traced.fates[traced.fate]

    assert reflected(widest_deg - 0.1)
    assert not reflected(widest_deg + 0.1)


def test_a_ray_that_misses_says_what_it_missed(oak: Rig) -> None:
    fates = {
        name: view_fates(rig, "left", np.array([slope, 0.0]))
        for name, rig, slope in (
            ("misses the prism base", oak, 2.5),
            ("misses the left mirror", changed(oak, length_mm=1.0), 0.2),
            ("is not totally reflected at the reflecting face", oak, 0.62),
            ("comes through", oak, 0.3),
        )
    }
    assert {name: one.fates[one.fate] for name, one in fates.items()} == {name: name for name in fates}


def test_a_pixel_of_the_other_half_misses_this_views_faces(oak: Rig) -> None:
    assert np.all(view_fates(oak, "left", slopes_of(oak, "right")).fate > 0)


def test_one_view_behind_a_plate_is_described_by_values_alone(oak: Rig) -> None:
    view = fold(oak, "left")
    again = FoldedView("left", view.R, view.t, view.plate_mm, view.index)
    np.testing.assert_array_equal(again.paraxial_centre_mm, view.paraxial_centre_mm)
    point = np.array([10.0, -5.0, 700.0])
    depth = view.view_from_rig(point)[2]
    assert depth == pytest.approx((point - view.paraxial_centre_mm) @ view.R[2])
