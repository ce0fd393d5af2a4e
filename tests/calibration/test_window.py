"""The range window: near end, far end and number of labels, of which any two give the third."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.errors import UsageError

SCALES = st.floats(1e3, 1e6)  # focal length times baseline: 1000 px at 50 mm is 5e4
NEARS = st.floats(50, 5000)
FARS = st.one_of(st.floats(60, 1e6), st.just(math.inf))


def window(scale: float, near: float, far: float, labels: int | None = None) -> DisparityWindow:
    """The window, or no example where it cannot be had."""
    assume(near < far)
    try:
        return DisparityWindow.between(scale, near, far, labels)
    except UsageError:
        assume(condition=False)
        raise


@given(SCALES, NEARS, FARS)
def test_the_far_end_lies_at_disparity_one(scale: float, near: float, far: float) -> None:
    made = window(scale, near, far)
    at_one = float(made.depth(np.float32([1.0]))[0])
    if math.isinf(far):
        assert at_one == made.farthest == math.inf
    else:
        assert made.farthest == pytest.approx(far, rel=1e-9)
        assert at_one == pytest.approx(far, rel=1e-5)


@given(SCALES, NEARS, FARS)
def test_the_near_end_lies_within_the_search_one_below_the_last_label(scale: float, near: float, far: float) -> None:
    made = window(scale, near, far)
    assert made.labels % 16 == 0
    assert made.nearest <= near * (1 + 1e-9)
    assert float(made.depth(np.float32([made.labels - 2]))[0]) == pytest.approx(made.nearest, rel=1e-5)
    if made.labels > 16:  # and no 16 labels are searched in vain
        assert scale / (made.labels - 16 - 2 + made.offset_px) > near * (1 - 1e-9)


@given(SCALES, FARS, st.integers(2, 64).map(lambda n: 16 * n))
def test_labels_and_far_end_give_the_near_end(scale: float, far: float, labels: int) -> None:
    offset = (scale / far if math.isfinite(far) else 0.0) - 1
    near = scale / (labels - 2 + offset)
    assert window(scale, near * (1 + 1e-6), far, labels).nearest == pytest.approx(near, rel=1e-9)
    assert DisparityWindow.between(scale, near * (1 + 1e-6), far).labels == labels
    with pytest.raises(UsageError, match=f"{labels} are searched"):
        DisparityWindow.between(scale, near * (1 - 1e-3), far, labels)


@given(SCALES, NEARS, FARS)
def test_near_end_and_labels_reach_no_farther_than_the_far_end(scale: float, near: float, far: float) -> None:
    made = window(scale, near, far)
    again = DisparityWindow(made.labels, made.offset_px, made.scale_px)
    assert (again.nearest, again.farthest) == (made.nearest, made.farthest)


@given(SCALES, NEARS, FARS, st.lists(st.floats(0, 1023, width=32), min_size=2, max_size=20, unique=True))
def test_depth_falls_as_disparity_rises(scale: float, near: float, far: float, disparities: list[float]) -> None:
    depth = window(scale, near, far).depth(np.sort(np.float32(disparities))).astype(float)
    finite = depth[np.isfinite(depth)]
    assert np.all(np.diff(finite) <= 0)
    assert np.all(np.isinf(depth[: len(depth) - len(finite)]))  # beyond infinity comes first
    assert np.all(depth > 0)


@given(SCALES, NEARS, FARS, st.floats(1, 1000))
def test_depth_is_focal_length_times_baseline_over_disparity_and_offset(
    scale: float, near: float, far: float, disparity: float
) -> None:
    made = window(scale, near, far)
    total = float(np.float32(disparity)) + made.offset_px
    expected = scale / total if total > 0 else math.inf
    assert float(made.depth(np.float32([disparity]))[0]) == pytest.approx(expected, rel=1e-6)


def test_unmatched_has_no_depth_and_beyond_infinity_is_infinite() -> None:
    made = DisparityWindow.between(5e4, 400.0, math.inf)
    depth = made.depth(np.float32([[np.nan, 0.0], [1.0, 0.999999]]))
    np.testing.assert_array_equal(depth, [[np.nan, np.inf], [np.inf, np.inf]])
    assert depth.dtype == np.float32


def test_a_depth_that_no_float_holds_is_infinite() -> None:
    assert DisparityWindow(16, 0.0, 5e4).depth(np.float32([1e-40]))[0] == np.inf


@pytest.mark.parametrize(
    ("near", "far", "words"),
    [
        (0.0, 1000.0, "range 0:1000 is empty: give near < far, both positive"),
        (-1.0, 1000.0, "is empty"),
        (500.0, 500.0, "range 500:500 is empty"),
        (math.inf, math.inf, "is empty"),
        (math.nan, 1000.0, "is empty"),
        (500.0, math.nan, "is empty"),
        (10.0, math.inf, "range 10:inf needs 5008 disparity labels, but 1024 are searched: begin at 49"),
        (1e-320, math.inf, "but 1024 are searched: begin at 49"),
    ],
)
def test_a_range_that_cannot_be_is_refused(near: float, far: float, words: str) -> None:
    with pytest.raises(UsageError, match=re.escape(words)):
        DisparityWindow.between(5e4, near, far)


@pytest.mark.parametrize(
    ("labels", "words"),
    [
        (64, "range 400:inf needs 128 disparity labels, but 64 are searched: begin at 820.1 or search 128 labels"),
        (3, "but 3 are searched: search 128 labels"),
        (0, "but 0 are searched: search 128 labels"),
        (-16, "but -16 are searched"),
        (1040, "1040 disparity labels: search at most 1024"),
    ],
)
def test_too_few_or_too_many_labels_are_refused_with_the_mend(labels: int, words: str) -> None:
    with pytest.raises(UsageError, match=re.escape(words)):
        DisparityWindow.between(5e4, 400.0, math.inf, labels)


@given(SCALES, NEARS, FARS, st.integers(1, 64).map(lambda n: 16 * n))
def test_every_mend_that_is_offered_works(scale: float, near: float, far: float, labels: int) -> None:
    assume(near < far)
    try:
        DisparityWindow.between(scale, near, far, labels)
    except UsageError as error:
        begin = re.search(r"begin at ([0-9.e+]+)", str(error))
        search = re.search(r"search (\d+) labels", str(error))
        assert begin or search
        if begin and float(begin[1]) < far:
            assert DisparityWindow.between(scale, float(begin[1]), far, labels).labels == labels
        if search:
            assert DisparityWindow.between(scale, near, far, int(search[1])).nearest <= near * (1 + 1e-9)


def test_a_pair_from_anywhere_has_labels_but_no_depth() -> None:
    made = DisparityWindow(64)
    assert math.isnan(made.nearest)
    assert math.isnan(made.farthest)
    with pytest.raises(UsageError, match="no focal length and baseline, so it has no depth: give a calibration"):
        made.depth(np.float32([1.0]))
