"""The optical twin: its frames show what the tracer says they must, and its truth is the truth."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import msgspec
import numpy as np
import pytest

from prismstereo_hw.frame import RawFrame
from prismstereo_hw.optics.figures import figures
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Rectangle, Scene, board, board_square_mm, facing_plane, named
from prismstereo_hw.texture import Noise, Plain
from prismstereo_hw.twin import Truth, Twin

X, Y, _ = np.eye(3)


def traced(rig: Rig, side: str, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where rays of raw pixels (N, 2) come out, where they go, and whether they do: by the tracer, not the closed form."""
    rays = view_fates(rig, side, rig.lens().slopes(pixels))
    return rays.point_mm, rays.direction, rays.fate == 0


def left_pixels(rig: Rig, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Raw pixels (N, 2) all over the left view, and their rows and columns in its truth."""
    x, y, w, h = rig.views[0].rectangle(rig.camera.video.width, rig.camera.video.height)
    rows, columns = (axis.ravel() for axis in np.mgrid[0:h:step, 0:w:step])
    return np.stack([columns + x, rows + y], axis=-1).astype(float), rows, columns


def axis_of(rig: Rig, side: str) -> tuple[np.ndarray, np.ndarray]:
    """The paraxial pinhole and the optical axis of a view, from the traced axis and a ray close to it."""
    rays = view_fates(rig, side, np.array([[0.0, 0.0], [0.0, 1e-4]]))
    (start, tilted_start), (axis, tilted) = rays.point_mm, rays.direction
    aside = np.cross(np.cross(tilted, axis), tilted)  # in the plane of both, square to the tilted one
    return start + ((tilted_start - start) @ aside) / (axis @ aside) * axis, axis


def test_the_truth_of_a_facing_plane_is_its_depth_along_the_optical_axis(
    rig: Rig, plane_truth: Callable[[float], Truth]
) -> None:
    pixels, rows, columns = left_pixels(rig, step=16)
    point, direction, comes = traced(rig, "left", pixels)
    met = point + (1000.0 - point[:, 2:]) / direction[:, 2:] * direction
    pinhole, axis = axis_of(rig, "left")
    depth = plane_truth(1000.0).depth_mm[rows, columns]

    np.testing.assert_array_equal(np.isfinite(depth), comes)
    np.testing.assert_allclose(depth[comes], ((met - pinhole) @ axis)[comes], rtol=0, atol=2e-3)
    assert np.isfinite(depth).mean() > 0.75


def test_the_rays_of_both_pixels_of_a_match_meet_in_one_point_of_the_surface(
    rig: Rig, plane_truth: Callable[[float], Truth]
) -> None:
    pixels, rows, columns = left_pixels(rig, step=16)
    match = plane_truth(1000.0).match_px[rows, columns].astype(float)
    matched = np.isfinite(match[:, 0])
    assert matched.mean() > 0.5
    meets = []
    for side, at in (("left", pixels[matched]), ("right", match[matched])):
        point, direction, comes = traced(rig, side, at)
        assert comes.all()
        meets.append(point + (1000.0 - point[:, 2:]) / direction[:, 2:] * direction)
    apart_px = np.linalg.norm(meets[0] - meets[1], axis=1) * rig.lens().fx_px / 1000.0
    assert apart_px.max() < 1e-3


def test_every_point_of_a_plane_is_matched_or_outside_of_the_right_view(
    rig: Rig, plane_truth: Callable[[float], Truth]
) -> None:
    truth = plane_truth(1000.0)
    seen, matched = np.isfinite(truth.depth_mm), np.isfinite(truth.match_px[..., 0])
    np.testing.assert_array_equal(truth.occluded, seen & ~matched)
    np.testing.assert_array_equal(truth.objects, seen.astype(np.uint8))
    x, y, w, h = rig.views[1].rectangle(rig.camera.video.width, rig.camera.video.height)
    match = truth.match_px[matched]
    assert np.all((match >= [x, y]) & (match <= [x + w - 1, y + h - 1]))


def test_both_views_show_the_same_grey_where_the_truth_says_they_match(
    rig: Rig, plane_frame: Callable[[float], RawFrame], plane_truth: Callable[[float], Truth]
) -> None:
    pixels, frame, truth = left_pixels(rig, step=1)[0], plane_frame(1000.0), plane_truth(1000.0)
    match = truth.match_px.reshape(-1, 2)
    found = np.isfinite(match[:, 0])
    here = frame.pixels[pixels[found, 1].astype(int), pixels[found, 0].astype(int)].astype(float)
    where = match[found].astype(np.float32).reshape(-1, 1, 2)
    pieces = [
        cv2.remap(frame.pixels.astype(np.float32), part, None, cv2.INTER_CUBIC) for part in np.array_split(where, 20)
    ]
    there = np.concatenate(pieces).ravel()
    moved = cv2.remap(
        frame.pixels.astype(np.float32), where[:20_000] + np.float32([1, 0]), None, cv2.INTER_CUBIC
    ).ravel()
    off = np.sqrt(np.mean((there - here) ** 2))
    assert off < 6.0  # sensor noise of 1 in both, and what interpolation costs; the texture's contrast is 30
    assert np.sqrt(np.mean((moved - here[:20_000]) ** 2)) > 1.5 * off  # one pixel further it no longer fits


def test_the_same_twin_gives_the_same_bytes(small: Rig) -> None:
    frames = [Twin(small, named(small, "desk"), seed=7).frame(3) for _ in range(2)]
    assert frames[0].pixels.tobytes() == frames[1].pixels.tobytes()
    assert (frames[0].index, frames[0].timestamp_us) == (3, 100_000)


def test_the_seed_and_the_index_make_the_noise_and_nothing_else(small: Rig) -> None:
    scene = facing_plane(small, 900.0)
    clean = Twin(small, scene, noise=0.0).frame().pixels.astype(int)
    one, other, later = (
        Twin(small, scene, seed=1).frame(),
        Twin(small, scene, seed=2).frame(),
        Twin(small, scene).frame(1),
    )
    lit = clean > 10
    for frame in (one, other, later):
        noise = frame.pixels[lit] - clean[lit]
        assert noise.std() == pytest.approx(np.sqrt(1 + 1 / 12), abs=0.05)  # and rounding
        assert abs(noise.mean()) < 0.05
    assert not np.array_equal(one.pixels, other.pixels)
    assert not np.array_equal(one.pixels, later.pixels)


def test_a_moving_thing_is_where_its_time_puts_it(small: Rig) -> None:
    twin = Twin(small, named(small, "desk"), noise=0.0)
    speed = twin.scene.surfaces[0].velocity_mm_s[0]
    depth = twin.scene.surfaces[0].centre_mm[2]
    before, after = (np.argwhere(twin.truth(0, stamp).objects == 1)[:, 1].mean() for stamp in (0, 500_000))
    moved_px = speed * 0.5 * small.lens().fx_px / (depth - fold(small, "left").paraxial_centre_mm[2])
    assert after - before == pytest.approx(moved_px, rel=0.1)
    assert twin.frame(2).timestamp_us == round(2e6 / 30)


def test_it_is_dark_where_total_reflection_is_lost(oak: Rig) -> None:
    frame = Twin(oak, facing_plane(oak, 1000.0), noise=0.0).frame()
    lens, video = oak.lens(), oak.camera.video
    row = video.height // 2
    columns = np.arange(video.width, dtype=float)
    slopes = lens.slopes(np.stack([columns, np.full_like(columns, row)], axis=-1))
    lost = np.where(slopes[:, 0] > 0, view_fates(oak, "left", slopes).fate, view_fates(oak, "right", slopes).fate) > 0
    np.testing.assert_array_equal(frame.pixels[row] == 0, lost)
    assert 1 - lost.mean() == pytest.approx(figures(oak).columns_kept, abs=0.002)
    assert lost[[0, -1]].all()
    assert not lost[video.width // 2]


def test_the_dark_has_no_truth(oak: Rig) -> None:
    truth = Twin(oak, facing_plane(oak, 1000.0)).truth()
    lost = ~np.isfinite(truth.depth_mm)
    assert 0.12 < lost.mean() < 0.184  # the middle row loses most: rays out of its plane meet the face more aslant
    assert np.isnan(truth.match_px[lost]).all()
    assert not truth.occluded[lost].any()
    assert not truth.objects[lost].any()


def test_what_meets_nothing_is_as_dark_as_the_background(small: Rig) -> None:
    void = Scene("void", (), background_grey=33.0)
    frame, truth = Twin(small, void, noise=0.0).frame(), Twin(small, void).truth()
    assert set(np.unique(frame.pixels)) == {0, 33}
    assert np.isnan(truth.depth_mm).all()
    assert not truth.objects.any()


def test_a_box_hides_the_wall_behind_its_left_edge_from_the_right_view(small: Rig) -> None:
    texture = Noise(seed=1, texel_mm=1.0)
    box = Rectangle("box", np.array([0.0, 0.0, 400.0]), X, Y, 40.0, 40.0, texture)
    wall = Rectangle("wall", np.array([0.0, 0.0, 800.0]), X, Y, np.inf, np.inf, texture)
    truth = Twin(small, Scene("box", (box, wall))).truth()
    assert set(np.unique(truth.objects)) == {0, 1, 2}

    left, right = fold(small, "left").paraxial_centre_mm, fold(small, "right").paraxial_centre_mm
    wall_rows, wall_columns = np.nonzero((truth.objects == 2) & (truth.depth_mm > 0))
    x, _, _, _ = small.views[0].rectangle(320, 180)
    point, direction, _ = traced(small, "left", np.stack([wall_columns + x, wall_rows], axis=-1).astype(float))
    met = point + (800.0 - point[:, 2:]) / direction[:, 2:] * direction
    behind = right + (400.0 - right[2]) / (met[:, 2:] - right[2]) * (met - right)  # where the right view's line passes
    margin = 40.0 - np.max(np.abs(behind[:, :2]), axis=1)
    hidden = truth.occluded[wall_rows, wall_columns]
    assert hidden[margin > 1.0].all()

    # in a row through the box the hidden strip lies on its left, as wide as the parallax between wall and box
    row = truth.objects[90]
    first = int(np.argmax(row == 1))
    strip = truth.occluded[90, :first][::-1]
    parallax_px = small.lens().fx_px * (right[0] - left[0]) * (1 / (400 - left[2]) - 1 / (800 - left[2]))
    assert int(np.argmin(strip)) == pytest.approx(parallax_px, abs=2.0)
    last = len(row) - 1 - int(np.argmax(row[::-1] == 1))
    assert not truth.occluded[90, last + 1 : last + 6].any()


def saddle_points(picture: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Where the blurred picture has its saddle points (N, 2), from a quadratic fitted around each guess (N, 2)."""
    blurred = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.5)
    y, x = (axis.astype(float) for axis in np.mgrid[-5:6, -5:6])
    weight = np.exp(-(x**2 + y**2) / 12).ravel()
    terms = np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], axis=-1).reshape(-1, 6)
    fit = np.linalg.pinv(terms * weight[:, None]) * weight
    found = near.astype(float).copy()
    for point in found:
        for _ in range(4):
            a, b, c, d, e, _ = fit @ cv2.getRectSubPix(blurred, (11, 11), tuple(point)).ravel().astype(float)
            point += np.linalg.solve([[2 * a, b], [b, 2 * c]], [-d, -e])
    return found


def test_board_corners_found_in_a_frame_lie_where_the_exact_projection_puts_them(rig: Rig) -> None:
    # 0.01 to 0.02 px rms; OpenCV's cornerSubPix on the sharp picture would add 0.07 of its own
    distance_mm = 1.05 * rig.range.near_mm
    square = board_square_mm(rig, distance_mm)
    angle = np.radians(15.0)
    R = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    grid = np.stack(np.meshgrid(np.arange(9), np.arange(7)), axis=-1).reshape(-1, 2) * square
    points = np.column_stack([grid, np.zeros(63)]) @ R.T
    points += np.array([0.0, 0.0, distance_mm]) - points.mean(axis=0)
    wall = Rectangle("wall", np.array([0.0, 0.0, 3 * distance_mm]), X, Y, np.inf, np.inf, Plain(90.0))
    frame = Twin(rig, Scene("board", (board(9, 7, square, R, points[0]), wall))).frame()
    for side, view in zip(("left", "right"), rig.views, strict=True):
        x, y, _, _ = view.rectangle(frame.width, frame.height)
        exact = rig.lens().project_slopes(fold(rig, side).slopes(points)) - [x, y]
        found = saddle_points(view.cut(frame.pixels), exact + 0.5)
        assert np.linalg.norm(found - exact, axis=1).max() < 0.05


def test_a_still_shows_the_same_with_more_pixels(small: Rig) -> None:
    scene = named(small, "desk")
    video = Twin(small, scene, noise=0.0).frame()
    still = Twin(small, scene, mode=Mode(width=640, height=360), noise=0.0).frame()
    assert (still.width, still.height) == (640, 360)
    halved = cv2.resize(still.pixels, (320, 180), interpolation=cv2.INTER_AREA)
    assert np.corrcoef(halved.ravel(), video.pixels.ravel())[0, 1] > 0.99


def test_a_lens_off_the_prism_axis_moves_the_seam(small: Rig) -> None:
    camera = msgspec.structs.replace(small.camera, principal_offset_px=(12.0, 0.0))
    shifted = msgspec.structs.replace(small, camera=camera)
    truth = Twin(shifted, facing_plane(shifted, 900.0)).truth()
    assert not np.isfinite(truth.depth_mm[:, :12]).any()  # these look through the other mirror
    assert np.isfinite(truth.depth_mm[:, 13:100]).all()
