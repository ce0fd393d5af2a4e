"""Dense SIFT: the same in any light, different for other things, and the same bits compiled or not."""

from __future__ import annotations

import numpy as np
import pytest

from host.motion_compositions import leaves
from prismstereo.fusion.motion import dense_sift_kernels as kernels
from prismstereo.fusion.motion.dense_sift import DenseSift

GREY = leaves(96, 128, 3).mean(axis=2)


def test_a_picture_in_half_the_light_has_the_same_descriptors() -> None:
    bright, dark = DenseSift.of(GREY), DenseSift.of(0.5 * GREY)
    assert float(bright.distances(dark, reach=0).max()) < 2e-3
    np.testing.assert_allclose(dark.texture, bright.texture / 2, rtol=1e-3)


def test_descriptors_have_unit_length_and_none_of_their_numbers_leads() -> None:
    found = DenseSift.of(GREY).descriptors
    np.testing.assert_allclose(np.linalg.norm(found, axis=2), 1, atol=1e-5)
    assert found.max() < 0.5
    assert found.shape == (21, 29, 128)  # 24 x 32 cells, four each way


def test_another_thing_is_far_and_a_step_to_the_side_is_forgiven() -> None:
    other = DenseSift.of(leaves(96, 128, 4).mean(axis=2))
    ours = DenseSift.of(GREY)
    assert float(np.median(ours.distances(other))) > 0.5
    shifted = DenseSift.of(np.roll(GREY, 4, axis=1))
    assert float(ours.distances(shifted, reach=1)[2:-2, 3:-3].max()) < 2e-3
    assert float(np.median(ours.distances(shifted, reach=0))) > 0.5


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 45.0, 100.0, 200.0, 315.0])
def test_a_ramp_s_gradient_goes_to_the_two_orientations_beside_it(angle_deg: float) -> None:
    rows, columns = np.mgrid[:32, :32].astype(np.float32)
    angle = np.radians(angle_deg)
    cells = np.zeros((8, 8, 8), np.float32)
    kernels.orientation_cells((3 * (columns * np.cos(angle) + rows * np.sin(angle))).astype(np.float32), 0, 32, cells)
    shares = cells[4, 4] / cells[4, 4].sum()
    octant = angle_deg / 45
    assert shares[int(octant) % 8] == pytest.approx(1 - octant % 1, abs=0.011)
    assert cells[4, 4].sum() == pytest.approx(3 * 16, rel=1e-3)  # the window's weights sum to 16


def test_compiled_and_plain_loops_agree() -> None:
    small = np.ascontiguousarray(GREY[:32, :36])
    cells, plain = (np.zeros((8, 9, 8), np.float32) for _ in range(2))
    kernels.orientation_cells(small, 0, 32, cells)
    kernels.orientation_cells.py_func(small, 0, 32, plain)
    np.testing.assert_allclose(cells, plain, rtol=1e-4, atol=1e-3)
    ours, theirs = np.empty((2, 5, 6, 128), np.float32)
    texture = np.empty((5, 6), np.float32)
    kernels.unit_descriptors(cells, 0.2, ours, texture)
    kernels.unit_descriptors.py_func(cells, 0.2, theirs, texture)
    np.testing.assert_allclose(ours, theirs, atol=1e-5)
    near, away = np.empty((2, 5, 6), np.float32)
    kernels.least_distances(ours, theirs[::-1].copy(), 1, near)
    kernels.least_distances.py_func(ours, theirs[::-1].copy(), 1, away)
    np.testing.assert_allclose(near, away, atol=1e-3)


def test_values_per_descriptor_are_spread_along_a_straight_line() -> None:
    rows, columns = np.mgrid[:21, :29].astype(np.float32)
    spread = DenseSift.spread(4 * columns + 7.5 + 2 * rows, (96, 128))
    y, x = np.mgrid[:96, :128]
    inside = np.s_[8:84, 8:116]
    np.testing.assert_allclose(spread[inside], (x + (y - 7.5) / 2)[inside], atol=0.15)
