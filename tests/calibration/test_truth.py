"""The true disparity of a rectified pair, from the twin's truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_calibration.truth import true_disparity
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import Rectangle, Scene
from prismstereo_hw.texture import Plain
from prismstereo_hw.twin import Truth, Twin


@pytest.fixture(scope="module")
def plane_disparity(rectified: Rectification, plane_truth: Callable[[float], Truth]) -> Callable[[float], np.ndarray]:
    return lambda distance_mm: true_disparity(plane_truth(distance_mm), rectified)


@pytest.mark.parametrize("distance_mm", [500.0, 1000.0])
def test_a_facing_plane_has_one_disparity_that_of_its_depth(
    distance_mm: float,
    rectified: Rectification,
    pinhole_z_mm: float,
    plane_disparity: Callable[[float], np.ndarray],
) -> None:
    # what is left is the glass: a view is not quite a pinhole (0.16 mm, or 0.3 px at 0.5 m for an OAK-1)
    disparity = plane_disparity(distance_mm)
    found = disparity[np.isfinite(disparity)].astype(float)
    assert found.size > 0.6 * disparity.size
    expected = rectified.window.scale_px / (distance_mm - pinhole_z_mm) - rectified.window.offset_px
    assert np.median(found) == pytest.approx(expected, abs=0.2)
    off = np.abs(found - np.median(found))
    assert np.percentile(off, 98) < 0.35
    assert off.max() < 0.45  # in the far corners


def test_true_disparities_lie_in_both_pictures(
    rectified: Rectification, plane_disparity: Callable[[float], np.ndarray]
) -> None:
    disparity = plane_disparity(1000.0)
    rows, columns = np.nonzero(np.isfinite(disparity))
    seen = np.isfinite(rectified.sources(rectified.left)[..., 0])
    assert seen[rows, columns].all()
    partner = columns - disparity[rows, columns]
    inside = (partner >= 0) & (partner <= rectified.width - 1)
    right_seen = np.isfinite(rectified.sources(rectified.right)[..., 0])
    at = np.clip(np.rint(partner), 0, rectified.width - 1).astype(int)
    assert right_seen[rows, at][inside].mean() > 0.995  # but for half a pixel along the border


def test_the_dark_has_no_true_disparity(oak: Rig) -> None:
    made = rectification(Calibration.nominal(oak))
    truth = Twin(oak, Scene("void", ())).truth()
    assert np.isnan(true_disparity(truth, made)).all()


@pytest.fixture(scope="module")
def steps(oak: Rig) -> tuple[np.ndarray, np.ndarray, Rectification]:
    """A box before a wall: true disparity, the index of the surface in the same rectified pixels, the rectification."""
    x, y, _ = np.eye(3)
    box = Rectangle("box", np.array([0.0, 0.0, 500.0]), x, y, 60.0, 60.0, Plain())
    wall = Rectangle("wall", np.array([0.0, 0.0, 1500.0]), x, y, np.inf, np.inf, Plain())
    made = rectification(Calibration.nominal(oak))
    truth = Twin(oak, Scene("box", (box, wall))).truth()
    source = made.sources(made.left)
    inside = np.isfinite(source[..., 0])
    at = np.where(inside[..., None], np.rint(source), 0).astype(int)
    objects = np.where(inside, truth.objects[at[..., 1], at[..., 0]], 0)
    return true_disparity(truth, made), objects, made


def test_nothing_is_interpolated_across_an_edge(steps: tuple[np.ndarray, np.ndarray, Rectification]) -> None:
    disparity, objects, made = steps
    levels = [made.window.scale_px / (z + 13.0) - made.window.offset_px for z in (500.0, 1500.0)]
    found = disparity[np.isfinite(disparity)]
    assert np.min(np.abs(found[:, None] - np.array(levels)), axis=1).max() < 1.5
    for index, level in enumerate(levels, start=1):
        assert np.nanmedian(disparity[objects == index]) == pytest.approx(level, abs=0.5)


def test_edges_and_what_they_hide_have_no_match(steps: tuple[np.ndarray, np.ndarray, Rectification]) -> None:
    disparity, objects, _ = steps
    row, shown = disparity[360], objects[360]
    first, last = np.flatnonzero(shown == 1)[[0, -1]]
    assert np.isnan(row[first - 1 : first + 1]).any()
    assert np.isnan(row[last : last + 2]).any()
    # hidden from the right view: as wide as both disparities differ, on the box's left
    difference = np.nanmedian(disparity[objects == 1]) - np.nanmedian(disparity[objects == 2])
    hidden = np.flatnonzero(np.isfinite(row[:first]))[-1]
    assert first - 1 - hidden == pytest.approx(difference, abs=2.5)
    assert np.isfinite(row[last + 3])
