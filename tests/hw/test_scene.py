"""Scenes: what stands where, what hides what, and the poses in which a calibration board is shown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from prismstereo_hw.errors import UsageError
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import SCENES, Rectangle, Scene, board, board_poses, facing_plane, named
from prismstereo_hw.texture import Plain

X, Y, Z = np.eye(3)
AHEAD = np.array([[0.0, 0.0, 1.0]])
HERE = np.zeros((1, 3))


def sheet(name: str, z_mm: float, half_mm: float = 50.0, **more: object) -> Rectangle:
    """A facing square at a distance."""
    return Rectangle(name, np.array([0.0, 0.0, z_mm]), X, Y, half_mm, half_mm, Plain(), **more)


def test_a_ray_meets_the_nearest_surface_on_its_way() -> None:
    scene = Scene("two", (sheet("far", 800.0), sheet("near", 300.0, half_mm=10.0)))
    start = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [70.0, 0.0, 0.0]])
    reach, which = scene.first_hit(start, np.repeat(AHEAD, 3, axis=0))
    np.testing.assert_allclose(reach, [300.0, 800.0, np.inf])
    np.testing.assert_array_equal(which, [1, 0, -1])


def test_a_surface_behind_or_beside_the_ray_is_not_met() -> None:
    assert sheet("behind", -100.0).distance(HERE, AHEAD) == np.inf
    floor = Rectangle("floor", np.array([0.0, 50.0, 0.0]), X, Z, np.inf, np.inf, Plain())
    np.testing.assert_array_equal(floor.distance(HERE, AHEAD), [np.inf])  # along it: no warning, no meeting
    np.testing.assert_array_equal(floor.distance(np.array([[0.0, 50.0, 0.0]]), AHEAD), [np.inf])  # within it
    down = np.array([[0.0, 1.0, 1.0]]) / math.sqrt(2)
    np.testing.assert_allclose(floor.distance(HERE, down), [50 * math.sqrt(2)])


def test_a_rectangle_ends_at_its_borders() -> None:
    square = sheet("square", 100.0, half_mm=10.0)
    start = np.array([[9.99, 0.0, 0.0], [10.01, 0.0, 0.0], [0.0, -9.99, 0.0], [0.0, 10.01, 0.0]])
    met = np.isfinite(square.distance(start, np.repeat(AHEAD, 4, axis=0)))
    np.testing.assert_array_equal(met, [True, False, True, False])


def test_things_move_straight_on_with_time() -> None:
    scene = Scene("cart", (sheet("cart", 500.0, velocity_mm_s=(100.0, 0.0, -50.0)),))
    np.testing.assert_allclose(scene.at(2.0).surfaces[0].centre_mm, [200.0, 0.0, 400.0])
    np.testing.assert_allclose(scene.surfaces[0].centre_mm, [0.0, 0.0, 500.0])


def test_a_board_shows_its_corners_where_its_pose_puts_them() -> None:
    angle = math.radians(20)
    R = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
    t = np.array([-40.0, -30.0, 500.0])
    shown = board(9, 7, 10.0, R, t)
    fine = np.full(4, 0.01)
    for i, j in ((0, 0), (8, 0), (0, 6), (8, 6), (4, 3)):
        corner = R @ np.array([10.0 * i, 10.0 * j, 0.0]) + t
        around = np.array([corner + du * R[:, 0] + dv * R[:, 1] for du, dv in ((-1, -1), (1, 1), (1, -1), (-1, 1))])
        grey = shown.shade(around, fine)
        assert abs(grey[0] - grey[2]) > 150
        np.testing.assert_allclose(grey[[0, 2]], grey[[1, 3]])


def test_a_board_has_a_white_margin_of_one_square_and_ends_there() -> None:
    shown = board(9, 7, 10.0, np.eye(3), np.array([0.0, 0.0, 500.0]))
    start = np.array([[x, 15.0, 0.0] for x in (-19.9, -20.1, 99.9, 100.1)])
    met = np.isfinite(shown.distance(start, np.repeat(AHEAD, 4, axis=0)))
    np.testing.assert_array_equal(met, [True, False, True, False])
    assert shown.shade(np.array([[-15.0, 15.0, 500.0]]), np.array([0.1])) == 220.0


def test_every_scene_has_a_name_that_makes_it(rig: Rig) -> None:
    for pattern in SCENES:
        name = pattern.replace("MM", "900")
        scene = named(rig, name)
        assert scene.name == name
        reach, _ = scene.first_hit(HERE, AHEAD)
        assert np.isfinite(reach).all()


def test_the_seed_changes_what_surfaces_look_like_and_nothing_else(oak: Rig) -> None:
    one, other = named(oak, "desk", seed=1), named(oak, "desk", seed=2)
    for a, b in zip(one.surfaces, other.surfaces, strict=True):
        np.testing.assert_array_equal(a.centre_mm, b.centre_mm)
        assert a.texture != b.texture


def test_a_facing_plane_is_endless_and_square_to_the_axis(oak: Rig) -> None:
    scene = facing_plane(oak, 640.0)
    sideways = np.array([[0.8, 0.0, 0.6], [0.0, -0.9, math.sqrt(0.19)]])
    reach, _ = scene.first_hit(np.zeros((2, 3)), sideways)
    np.testing.assert_allclose(reach * sideways[:, 2], 640.0)


def test_one_thing_on_the_desk_moves(oak: Rig) -> None:
    moving = [surface.name for surface in named(oak, "desk").surfaces if any(surface.velocity_mm_s)]
    assert moving == ["box"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("garden", r"there is no scene 'garden': choose one of plane:MM, desk, board:MM"),
        ("", r"there is no scene ''"),
        ("desk:500", r"there is no scene 'desk:500'"),
        ("plane", r"scene 'plane': give the distance in mm after the colon"),
        ("plane:", r"give the distance in mm"),
        ("plane:near", r"give the distance in mm"),
        ("plane:nan", r"give the distance in mm"),
        ("plane:inf", r"up to 1e8"),
        ("board:-500", r"beyond the rig itself"),
        ("plane:500:2", r"e\.g\. plane:500"),
        ("plane:50", r"beyond the rig itself and up to 1e8: 58 to 1e8"),  # between the mirrors
    ],
)
def test_a_scene_that_cannot_be_is_refused_with_what_can(oak: Rig, name: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        named(oak, name)


def test_board_poses_show_all_corners_to_both_views(rig: Rig) -> None:
    lens, video = rig.lens(), rig.camera.video
    columns, rows = 9, 7
    poses = board_poses(rig, 12, seed=4, columns=columns, rows=rows)
    assert len(poses) == 12
    for square, R, t in poses:
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        corners = [R @ np.array([i * square, j * square, 0]) + t for i in range(columns) for j in range(rows)]
        for side, view in zip(("left", "right"), rig.views, strict=True):
            slopes = fold(rig, side).slopes(np.array(corners))
            pixels = lens.project_slopes(slopes)
            x, y, w, h = view.rectangle(video.width, video.height)
            assert np.all((pixels >= [x, y]) & (pixels <= [x + w - 1, y + h - 1]))
            assert np.all(view_fates(rig, side, slopes).fate == 0)


def test_board_poses_spread_in_distance_and_tilt_and_are_the_same_for_a_seed(oak: Rig) -> None:
    poses, again, other = (board_poses(oak, 12, seed=seed) for seed in (4, 4, 5))
    tilts = [math.degrees(math.acos(R[2, 2])) for _, R, _ in poses]
    distances = [(R @ np.array([4 * square, 3 * square, 0]) + t)[2] for square, R, t in poses]
    assert max(tilts) > 20
    assert max(distances) / min(distances) > 1.25
    assert all(np.array_equal(a[1], b[1]) for a, b in zip(poses, again, strict=True))
    assert not any(np.array_equal(a[1], b[1]) for a, b in zip(poses, other, strict=True))


def test_a_board_that_fits_nowhere_is_refused(oak: Rig) -> None:
    with pytest.raises(UsageError, match="no 3 board poses fit the common field of rig 'oak-1'"):
        board_poses(oak, 3, seed=1, columns=9, rows=60)
