"""The lens: pixels to slopes and back, whatever its distortion, and what resizing and mirroring make of it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prismstereo_hw.lens import Lens


def lenses() -> st.SearchStrategy[Lens]:
    """Lenses from tele to wide with every term of the distortion, on a frame of about 1280x720."""
    return st.builds(
        Lens,
        fx_px=st.floats(600, 4000),
        fy_px=st.floats(600, 4000),
        cx_px=st.floats(540, 740),
        cy_px=st.floats(260, 460),
        distortion=st.tuples(
            st.floats(-0.3, 0.6),
            st.floats(-0.1, 0.3),
            st.floats(-4e-3, 4e-3),
            st.floats(-4e-3, 4e-3),
            st.floats(0, 0.1),
        ),
    )


PIXELS = st.tuples(st.floats(0, 1279), st.floats(0, 719)).map(np.array)


@given(lenses(), PIXELS)
def test_a_pixel_comes_back_from_its_slopes(lens: Lens, pixel: np.ndarray) -> None:
    slopes = lens.slopes(pixel)
    assume(np.isfinite(slopes).all())  # a strong barrel folds before the corner: see below
    np.testing.assert_allclose(lens.project_slopes(slopes), pixel, rtol=0, atol=1e-7)


@given(lenses(), st.tuples(st.floats(-0.6, 0.6), st.floats(-0.4, 0.4)).map(np.array))
def test_slopes_come_back_from_their_pixel(lens: Lens, slopes: np.ndarray) -> None:
    assume(lens.one_to_one(1.05 * slopes))
    np.testing.assert_allclose(lens.slopes(lens.project_slopes(slopes)), slopes, rtol=0, atol=1e-9)


@given(lenses(), st.tuples(st.floats(-300, 300), st.floats(-200, 200), st.floats(300, 3000)).map(np.array))
def test_points_are_projected_as_opencv_does(lens: Lens, point: np.ndarray) -> None:
    reference = cv2.projectPoints(point[None], np.zeros(3), np.zeros(3), lens.K, np.array(lens.distortion))[0]
    np.testing.assert_allclose(lens.project(point), np.ravel(reference), rtol=0, atol=1e-6)


def test_points_behind_the_lens_have_no_pixel() -> None:
    lens = Lens(1000, 1000, 639.5, 359.5)
    pixels = lens.project(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_array_equal(np.isnan(pixels[:, 0]), [True, True, False])


def test_a_strong_pincushion_is_undone_at_the_border_of_a_wide_field() -> None:
    lens = Lens(500, 500, 639.5, 359.5, (0.5, 0.0, 0.0, 0.0, 0.0))
    slopes = np.array([[1.5, 0.2], [-0.7, 1.4]])
    np.testing.assert_allclose(lens.slopes(lens.project_slopes(slopes)), slopes, rtol=0, atol=1e-10)


def test_a_barrel_is_undone_up_to_its_fold_and_beyond_it_no_ray_is_invented() -> None:
    # r (1 - r^2 / 2) is 0.544 at 0.8 and rises until r^2 = 2/3, where it is 0.5443: no ray comes out further off
    lens = Lens(1000, 1000, 0, 0, (-0.5, 0.0, 0.0, 0.0, 0.0))
    inside, outside = lens.slopes(np.array([[544.0, 0.0], [545.0, 0.0]]))
    assert inside[0] == pytest.approx(0.8, abs=1e-9)
    assert np.isnan(outside).all()


def test_one_to_one_ends_at_the_first_fold() -> None:
    lens = Lens(1000, 1000, 0, 0, (-0.5, 0.0, 0.0, 0.0, 0.0))
    radius = np.sqrt(2 / 3)
    slopes = np.array([[0.99 * radius, 0.0], [1.01 * radius, 0.0], [np.nan, 0.0]])
    np.testing.assert_array_equal(lens.one_to_one(slopes), [True, False, False])
    assert Lens(1000, 1000, 0, 0).one_to_one(np.array([1e6, 0.0]))


def test_one_bad_pixel_does_not_spoil_the_others() -> None:
    lens = Lens(1000, 1000, 0, 0, (-0.5, 0.0, 0.0, 0.0, 0.0))
    slopes = lens.slopes(np.array([[np.nan, 0.0], [1e9, 1e9], [300.0, -200.0]]))
    assert np.isnan(slopes[:2]).all()
    np.testing.assert_allclose(lens.project_slopes(slopes[2]), [300.0, -200.0], atol=1e-9)


@given(lenses(), PIXELS, st.floats(0.1, 8))
def test_resizing_moves_a_pixel_by_the_rule_for_pixel_centres(lens: Lens, pixel: np.ndarray, factor: float) -> None:
    slopes = lens.slopes(pixel)
    assume(np.isfinite(slopes).all())
    np.testing.assert_allclose(
        lens.scaled(factor).project_slopes(slopes), factor * (pixel + 0.5) - 0.5, rtol=0, atol=1e-6
    )


@given(lenses(), PIXELS, st.floats(0, 1279))
def test_a_mirrored_lens_sees_the_mirrored_scene(lens: Lens, pixel: np.ndarray, axis_px: float) -> None:
    slopes = lens.slopes(pixel)
    assume(np.isfinite(slopes).all())
    mirrored = lens.mirrored(axis_px).project_slopes(slopes * [-1, 1])
    np.testing.assert_allclose(mirrored, [2 * axis_px - pixel[0], pixel[1]], rtol=0, atol=1e-6)


@given(lenses(), st.floats(0, 1279))
def test_mirroring_twice_is_nothing(lens: Lens, axis_px: float) -> None:
    twice = lens.mirrored(axis_px).mirrored(axis_px)
    assert twice.cx_px == pytest.approx(lens.cx_px)
    assert twice.distortion == lens.distortion
