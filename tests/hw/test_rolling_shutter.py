"""A rolling shutter skews what moves, and both views by as much: a row is exposed at one instant, across the frame."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from prismstereo_hw.optics.sight import sight
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Rectangle, Scene
from prismstereo_hw.sensor import SensorModel
from prismstereo_hw.texture import Plain
from prismstereo_hw.twin import Twin

X, Y, _ = np.eye(3)
SPEED_MM_S, LINE_US, Z_MM = 500.0, 200.0, 700.0


@pytest.fixture(scope="module")
def door(oak: Rig) -> tuple[Rig, Scene]:
    """An edge that moves to the right, and a sensor of 200 fine rows."""
    camera = msgspec.structs.replace(oak.camera, video=Mode(width=1280, height=200, rate_hz=30.0))
    edge = Rectangle(
        "door", np.array([1e4, 0.0, Z_MM]), X, Y, 1e4, 1e4, Plain(200.0), velocity_mm_s=(SPEED_MM_S, 0.0, 0.0)
    )
    return msgspec.structs.replace(oak, camera=camera), Scene("door", (edge,), background_grey=40.0)


def edge_columns(picture: np.ndarray) -> np.ndarray:
    """For each row of a view's cut-out picture, the column after which it is bright."""
    inner = picture[:, 60:-60].astype(int)
    return 60 + np.argmax(np.diff(inner, axis=1) > 80, axis=1)


def exact_columns(rig: Rig, side: str, seconds: np.ndarray) -> np.ndarray:
    """Where the edge stands in the raw frame's rows at a time for each row, by projection."""
    rows = np.arange(len(seconds), dtype=float)
    view, columns = sight(rig, side), np.full(len(rows), rig.lens().cx_px)
    y_mm = np.zeros(len(rows))
    for _ in range(30):  # the height on the edge that falls into the row
        points = np.stack([SPEED_MM_S * seconds, y_mm, np.full(len(rows), Z_MM)], axis=-1)
        pixels = rig.lens().project_slopes(view.slopes(points))
        y_mm += (rows - pixels[:, 1]) * Z_MM / rig.lens().fy_px
        columns = pixels[:, 0]
    return columns


@pytest.mark.parametrize("line_us", [0.0, LINE_US])
def test_row_r_of_both_views_shows_the_instant_of_row_r(door: tuple[Rig, Scene], line_us: float) -> None:
    rig, scene = door
    sensor = noiseless(line_us)
    frame = Twin(rig, scene, sensor=sensor).frame(timestamp_us=2_000)
    seconds = (2_000 + line_us * np.arange(200)) / 1e6
    for side, view in zip(("left", "right"), rig.views, strict=True):
        x, _, _, _ = view.rectangle(1280, 200)
        exact = exact_columns(rig, side, seconds) - x
        np.testing.assert_allclose(edge_columns(view.cut(frame.pixels)) + 0.5, exact, atol=0.51)
        skew_px = exact[-1] - exact[0]
        assert skew_px == pytest.approx(line_us * 199e-6 * SPEED_MM_S * rig.lens().fx_px / Z_MM, rel=0.1)


def test_side_by_side_views_have_the_same_disparity_under_either_shutter(door: tuple[Rig, Scene]) -> None:
    rig, scene = door
    disparities = []
    for line_us in (0.0, LINE_US):
        frame = Twin(rig, scene, sensor=noiseless(line_us)).frame()
        left, right = (edge_columns(view.cut(frame.pixels)) for view in rig.views)
        disparities.append(left - right)
    # were the views exposed one after the other, 200 rows apart, the edge would be 26 px off
    skewed_apart = LINE_US * 200e-6 * SPEED_MM_S * rig.lens().fx_px / Z_MM
    assert skewed_apart > 20
    np.testing.assert_allclose(disparities[1], disparities[0], atol=2)
    assert abs(np.mean(disparities[1] - disparities[0])) < 0.5


def test_the_truth_is_that_of_each_row_s_own_time(door: tuple[Rig, Scene]) -> None:
    rig, scene = door
    twin = Twin(rig, scene, sensor=noiseless(LINE_US))
    truth, picture = twin.truth(), rig.views[0].cut(twin.frame().pixels)
    np.testing.assert_array_equal(truth.objects > 0, picture == 200)
    x, _, _, _ = rig.views[1].rectangle(1280, 200)
    rows = np.arange(40, 160)
    first = edge_columns(picture)[rows] + 1  # the first pixel on the door
    match = truth.match_px[rows, first]
    there = edge_columns(rig.views[1].cut(twin.frame().pixels))[np.rint(match[:, 1]).astype(int)] + x
    np.testing.assert_allclose(match[:, 0] - there, 1.0, atol=1.1)  # a part of a pixel from the edge in either view


def noiseless(line_us: float) -> SensorModel:
    return SensorModel(shot_noise=False, read_noise_electrons=0.0, rolling_shutter_us=line_us)
