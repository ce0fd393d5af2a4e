"""The filters' compiled loops do what a slow reference in plain numpy does, with the same bits for any number of threads."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numba.core import config

from device import filter_references as reference
from prismstereo_device import compiled as compiling
from prismstereo_device.filters import filter_kernels as kernels
from prismstereo_device.filters.bands import in_bands
from prismstereo_device.filters.median_kernels import median_rows
from prismstereo_device.filters.speckle_kernels import find_speckles

REACH = tuple(np.float32(number) for number in (1.0, 0.25, 0.02, -1.0))
SURE = np.uint8(200)


def patches(rng: np.random.Generator, height: int, width: int, holes: float = 0.15) -> np.ndarray:
    """Surfaces of many depths, on sixteenths of a pixel with a little noise, and holes."""
    rough = cv2.resize(rng.uniform(0, 60, (height // 4, width // 5)).astype(np.float32), (width, height))
    stepped = np.round(rough / 6) * 6 + rng.normal(0, 0.2, (height, width))
    steps = np.round(np.maximum(stepped, 0) * 16).astype(np.float32) / 16
    return np.where(rng.random((height, width)) < holes, np.float32(np.nan), steps)


@pytest.mark.parametrize("radius", [1, 2, 3])
def test_levelling_is_the_mean_of_opposite_pairs_of_one_surface(radius: int, rng: np.random.Generator) -> None:
    disparity = patches(rng, 21, 33)
    out = np.empty_like(disparity)
    padded = np.pad(disparity, radius, constant_values=np.nan)
    kernels.level_rows(padded, radius, 0, 21, *REACH, out)
    np.testing.assert_allclose(out, reference.levelled(disparity, radius, REACH), atol=1e-5)


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_the_closest_of_each_block_is_its_largest_disparity(factor: int, rng: np.random.Generator) -> None:
    disparity = patches(rng, 22, 31, holes=0.6)
    confidence, reasons = rng.integers(1, 256, (2, 22, 31), np.uint8)
    expected = reference.closest(disparity, factor)
    out, sure, why = np.empty_like(expected), np.empty(expected.shape, np.uint8), np.empty(expected.shape, np.uint8)
    kernels.closest_of_blocks(disparity, confidence, reasons, factor, out, sure, why)
    np.testing.assert_array_equal(out, expected)
    for y, x in np.ndindex(*expected.shape):
        block = np.s_[y * factor : (y + 1) * factor, x * factor : (x + 1) * factor]
        if np.isnan(expected[y, x]):
            counts = np.bincount(reasons[block].ravel(), minlength=256)
            assert (sure[y, x], why[y, x]) == (0, counts.argmax())
        else:
            assert sure[y, x] in confidence[block][disparity[block] == expected[y, x]]


def test_gaps_are_filled_from_the_farther_side_of_their_row(rng: np.random.Generator) -> None:
    disparity = patches(rng, 30, 40, holes=0.5)
    closed = (rng.random(disparity.shape) < 0.05) & np.isnan(disparity)
    out, filled = np.empty_like(disparity), np.zeros(disparity.shape, bool)
    kernels.fill_rows(disparity, closed, 4, out, filled)
    np.testing.assert_array_equal(out, reference.filled_rows(disparity, closed, 4))
    np.testing.assert_array_equal(filled, np.isnan(disparity) & ~np.isnan(out))
    assert filled.mean() > 0.2


@pytest.mark.parametrize(("largest", "step"), [(1, 0.5), (6, 1.0), (25, 2.0), (10_000, 1.0)])
def test_speckles_are_those_of_opencv(largest: int, step: float, rng: np.random.Generator) -> None:
    for holes in (0.0, 0.15, 0.45, 1.0):
        disparity = patches(rng, 60, 85, holes)
        sixteenths = np.where(np.isnan(disparity), -16, disparity * 16).astype(np.int16)
        cv2.filterSpeckles(sixteenths, -16, largest, step * 16)
        taken = np.zeros(disparity.shape, bool)
        find_speckles(disparity, largest, np.float32(step), taken)
        np.testing.assert_array_equal(taken & ~np.isnan(disparity), (sixteenths == -16) & ~np.isnan(disparity))


def test_an_island_that_winds_about_is_one_island() -> None:
    # a spiral of 1-pixel arms: its runs meet only at its turns
    spiral = np.array([[1, 1, 1, 1, 1], [0, 0, 0, 0, 1], [1, 1, 1, 0, 1], [1, 0, 0, 0, 1], [1, 1, 1, 1, 1]])
    disparity = np.where(spiral == 1, 7.0, np.nan).astype(np.float32)
    for largest, all_taken in ((16, False), (17, True)):
        taken = np.zeros((5, 5), bool)
        find_speckles(disparity, largest, np.float32(1), taken)
        assert taken[spiral == 1].all() == all_taken
        assert taken.any() == all_taken


@pytest.mark.parametrize(("radius", "stride"), [(2, 1), (4, 2)])
def test_the_median_weighs_by_confidence_and_by_brightness(radius: int, stride: int, rng: np.random.Generator) -> None:
    disparity = patches(rng, 20, 26)
    confidence, picture = rng.integers(1, 256, (2, 20, 26), np.uint8)
    alike = np.rint(255 * np.exp(-(np.arange(256) ** 2) / (2 * 60.0**2))).astype(np.int32)
    doubtful = (rng.random(disparity.shape) < 0.7).astype(np.uint8)
    out, sure = np.empty_like(disparity), np.empty_like(confidence)
    median_rows(disparity, confidence, picture, alike, doubtful, *REACH, radius, stride, 0, 20, out, sure)
    for y, x in np.ndindex(*disparity.shape):
        rows = np.array([r for r in range(y - radius, y + radius + 1, stride) if 0 <= r < 20])
        columns = np.array([c for c in range(x - radius, x + radius + 1, stride) if 0 <= c < 26])
        values = disparity[np.ix_(rows, columns)]
        there = ~np.isnan(values)
        likeness = alike[np.abs(picture[np.ix_(rows, columns)].astype(int) - int(picture[y, x]))]
        weights = (confidence[np.ix_(rows, columns)] * likeness)[there].astype(np.int64)
        expected = disparity[y, x]
        if doubtful[y, x] and not np.isnan(expected):
            expected = reference.median(values[there], weights, float(expected), REACH)
        np.testing.assert_equal(out[y, x], np.float32(expected))
        assert sure[y, x] <= confidence[y, x]
    assert np.nanmean(out != disparity) > 0.2


def test_edges_are_marked_on_both_of_their_sides() -> None:
    disparity = np.array([[10, 10.2, 30, 30, np.nan, 30]], np.float32)
    edge = np.zeros(disparity.shape, np.uint8)
    kernels.mark_edges(disparity, *REACH, edge)
    np.testing.assert_array_equal(edge, [[0, 1, 1, 1, 1, 1]])


def test_a_tolerance_is_two_percent_of_the_parallax_between_a_quarter_pixel_and_a_label() -> None:
    for disparity, expected in ((3.0, 0.25), (31.0, 0.6), (90.0, 1.0), (np.nan, 0.25)):
        assert kernels.tolerance(np.float32(disparity), *REACH) == pytest.approx(expected)


def test_bands_make_up_all_rows_once_whatever_the_threads() -> None:
    for height, threads in ((1, 8), (63, 2), (128, 2), (130, 3), (1000, 7)):
        seen = np.zeros(height, int)

        def work(first: int, end: int, seen: np.ndarray = seen) -> None:
            seen[first:end] += 1

        in_bands(work, height, threads)
        np.testing.assert_array_equal(seen, 1)


def test_kernels_run_where_nothing_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    # all that numba may try is a folder that cannot be made: as on a camera with a read-only disk and no home
    monkeypatch.setattr(config, "CACHE_DIR", "/proc/nowhere")
    monkeypatch.setattr(config, "CACHE_LOCATOR_CLASSES", "UserProvidedCacheLocator")

    def twice(number: int) -> int:
        return 2 * number

    assert compiling.compiled(twice)(21) == 42
