"""Views: which rectangle of the raw frame each viewpoint fills, and how it stands in there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_hw.errors import RigError, UsageError
from prismstereo_hw.view import LAYOUTS, View, layout


@st.composite
def views(draw: st.DrawFn) -> View:
    """Any rectangle of at least a tenth of the frame each way, in any attitude."""
    width, height = draw(st.floats(0.1, 1)), draw(st.floats(0.1, 1))
    return View(
        left=draw(st.floats(0, 1)) * (1 - width),
        top=draw(st.floats(0, 1)) * (1 - height),
        width=width,
        height=height,
        mirrored=draw(st.booleans()),
        turn_deg=draw(st.sampled_from([0, 90, 180, 270])),
    )


SIZES = st.tuples(st.integers(16, 200), st.integers(16, 200))  # width, height; coordinates fit 8 bits


def _coordinates(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Pictures whose grey level is the column and the row of each pixel."""
    rows, columns = np.mgrid[:height, :width]
    return columns.astype(np.uint8), rows.astype(np.uint8)


@given(views(), SIZES)
def test_a_pixel_of_the_cut_out_view_says_where_it_stood_in_the_frame(view: View, size: tuple[int, int]) -> None:
    x, y, _, _ = view.rectangle(*size)
    column, row = (view.cut(picture) for picture in _coordinates(*size))
    assert column.shape[::-1] == view.upright_size(*size)

    v, u = np.indices(column.shape)
    raw = view.raw_from_upright(np.stack([u + x, v + y], axis=-1).astype(float), *size)

    np.testing.assert_array_equal(raw[..., 0], column)
    np.testing.assert_array_equal(raw[..., 1], row)


@given(views(), SIZES, st.floats(-50, 250), st.floats(-50, 250))
def test_upright_and_raw_coordinates_are_one_to_one(view: View, size: tuple[int, int], x: float, y: float) -> None:
    point = np.array([x, y])
    np.testing.assert_allclose(
        view.raw_from_upright(view.upright_from_raw(point, *size), *size), point, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(
        view.upright_from_raw(view.raw_from_upright(point, *size), *size), point, rtol=0, atol=1e-9
    )


@given(views(), SIZES, st.lists(st.floats(0, 199), min_size=4, max_size=4))
def test_turning_and_mirroring_keep_distances(view: View, size: tuple[int, int], four: list[float]) -> None:
    a, b = np.array(four[:2]), np.array(four[2:])
    moved = view.upright_from_raw(np.stack([a, b]), *size)
    assert np.linalg.norm(moved[0] - moved[1]) == pytest.approx(np.linalg.norm(a - b), abs=1e-9)


@given(st.integers(16, 4000), st.integers(16, 4000))
def test_the_halves_of_every_layout_tile_the_frame(width: int, height: int) -> None:
    for left, right in LAYOUTS.values():
        (xl, yl, wl, hl), (xr, yr, wr, hr) = left.rectangle(width, height), right.rectangle(width, height)
        assert wl * hl + wr * hr == width * height
        assert (xl, yl) != (xr, yr)
        assert max(xl + wl, xr + wr) == width
        assert max(yl + hl, yr + hr) == height


def test_a_prism_with_its_base_to_the_lens_crosses_the_views() -> None:
    frame = np.zeros((4, 8), np.uint8)
    frame[:, 4:] = 200
    left, right = layout("swapped")
    assert left.cut(frame).min() == 200
    assert right.cut(frame).max() == 0


def test_side_by_side_does_not_cross_them() -> None:
    frame = np.zeros((4, 8), np.uint8)
    frame[:, 4:] = 200
    left, right = layout("side-by-side")
    assert (left.cut(frame).max(), right.cut(frame).min()) == (0, 200)


def test_a_turned_view_is_turned_counter_clockwise_and_then_mirrored() -> None:
    frame = np.array([[1, 2, 3], [4, 5, 6]], np.uint8)
    whole = {"left": 0.0, "top": 0.0, "width": 1.0, "height": 1.0}
    np.testing.assert_array_equal(View(**whole, turn_deg=90).cut(frame), [[3, 6], [2, 5], [1, 4]])
    np.testing.assert_array_equal(View(**whole, turn_deg=90, mirrored=True).cut(frame), [[6, 3], [5, 2], [4, 1]])


def test_an_ordinary_view_has_the_coordinates_of_the_raw_frame() -> None:
    point = np.array([700.25, 31.5])
    for view in LAYOUTS["swapped"]:
        np.testing.assert_array_equal(view.upright_from_raw(point, 1280, 720), point)


def test_colour_frames_are_cut_like_grey_ones(rng: np.random.Generator) -> None:
    frame = rng.integers(0, 256, (30, 40, 3), np.uint8)
    view = View(left=0.25, top=0.0, width=0.5, height=1.0, mirrored=True, turn_deg=270)
    for channel in range(3):
        np.testing.assert_array_equal(view.cut(frame)[..., channel], view.cut(frame[..., channel]))


@pytest.mark.parametrize(
    "edges",
    [
        (-0.1, 0, 0.5, 1), (0, -0.1, 1, 1), (0.6, 0, 0.5, 1), (0, 0.6, 1, 0.5), (0, 0, 0, 1), (0, 0, 1, 0),
        (0, 0, -0.5, 1), (math.nan, 0, 0.5, 1), (0, math.nan, 1, 1), (0, 0, math.nan, 1), (0, 0, 1, math.inf),
        (-math.inf, 0, 1, 1),
    ],
)  # fmt: skip
def test_a_rectangle_that_leaves_the_frame_is_refused(edges: tuple[float, float, float, float]) -> None:
    with pytest.raises(RigError, match="leaves the frame: give fractions of the frame between 0 and 1"):
        View(left=edges[0], top=edges[1], width=edges[2], height=edges[3])


def test_an_unknown_layout_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(UsageError, match=r"no layout 'crossed': choose one of side-by-side, swapped, top-bottom"):
        layout("crossed")
