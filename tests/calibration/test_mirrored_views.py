"""Views that stand otherwise in the frame, through the same code: mirrored by a single mirror, or in every other row.

The simulator here reflects points in mirrors and looks at them with the one pinhole; it knows no
`Lens.mirrored` and no `View.upright_lens`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.traced_boards import SQUARE_MM, traced_detection
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Sighting
from prismstereo_calibration.judging.quality import judge
from prismstereo_calibration.solving import one_lens
from prismstereo_calibration.solving.fit import Start, fit_frames
from prismstereo_calibration.solving.solve import solve
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import View

Array = NDArray[np.float64]
Look = Callable[[Array], Array]

LENS = Lens(1300.0, 1300.0, 645.0, 354.0, (-0.08, 0.04, 0.0, 0.0, 0.0))
BOARD = Board(9, 6, 8.0)
DIRECT_LEFT = View(left=0.0, top=0.0, width=0.5, height=1.0)
MIRRORED_RIGHT = View(left=0.5, top=0.0, width=0.5, height=1.0, mirrored=True)
MIRRORED_LEFT = View(left=0.0, top=0.0, width=0.5, height=1.0, mirrored=True)


def reflected(points: Array, point_mm: Array, normal: Array) -> Array:
    return points - 2 * ((points - point_mm) @ normal)[..., None] * normal


def in_view(pixels: Array, view: View) -> bool:
    x, y, w, h = view.rectangle(1280, 720)
    return bool(((pixels >= [x + 3, y + 3]) & (pixels <= [x + w - 4, y + h - 4])).all())


def tilted(random: np.random.Generator) -> Array:
    a, b = random.uniform(-0.5, 0.5, 2)
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    return about_x @ about_y


def detection_of(views: tuple[View, View], look: tuple[Look, Look], box: tuple[Array, Array], seed: int) -> Detection:
    """Fourteen boards between two corners of a box; each of `look` says where its view sees scene points stand."""
    random = np.random.default_rng(seed)
    flat = BOARD.points() - BOARD.points().mean(axis=0)
    pairs: list[Sighting] = []
    for _ in range(3000):
        points = flat @ tilted(random).T + random.uniform(*box)
        raw = [LENS.project(seen(points)) for seen in look]
        if all(in_view(pixels, view) for pixels, view in zip(raw, views, strict=True)):
            upright = [
                view.upright_from_raw(pixels + random.normal(0, 0.2, pixels.shape), 1280, 720)
                for pixels, view in zip(raw, views, strict=True)
            ]
            pairs.append(Sighting.of(f"{len(pairs)}.png", *upright))
        if len(pairs) == 14:
            return Detection(1280, 720, views, tuple(pairs))
    raise AssertionError("no boards fit both views")


def test_one_mirrored_view_beside_a_direct_one() -> None:
    """One mirror beside the axis (optics, rig c'): the right half shows the scene's mirror image from the other side.

    The camera at the origin and its image in the mirror x = 30 stand 60 mm apart.
    """
    point, normal = np.array([30.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    views = (DIRECT_LEFT, MIRRORED_RIGHT)
    look = np.asarray, partial(reflected, point_mm=point, normal=normal)
    detection = detection_of(views, look, (np.array([-70, -40, 330.0]), np.array([0, 40, 480.0])), 1)
    solution = solve(detection, BOARD, model="one-lens")
    found = solution.calibration
    assert solution.rms_px == pytest.approx(0.28, abs=0.015)
    assert found.baseline == pytest.approx(60.0, abs=0.2)
    assert found.left.lens.fx_px == pytest.approx(LENS.fx_px, rel=5e-3)
    assert found.left.lens.cx_px == pytest.approx(LENS.cx_px, abs=3)
    middle = 640 + (640 - 1) / 2
    assert found.right.lens.cx_px == pytest.approx(2 * middle - found.left.lens.cx_px, abs=1e-6)
    assert judge(found, detection, BOARD, rms_px=solution.rms_px).verdict == "good"


def test_two_mirrored_views_of_two_mirrors() -> None:
    """Two mirrors hinged before the lens and turned back 8 degrees (optics, rig a): B = 2 x 200 sin 16 = 110.26 mm.

    The scene is behind the camera, so the mirror on the camera's right gives the left view.
    """
    hinge, tilt = np.array([0.0, 0.0, 200.0]), math.radians(8.0)
    through_right, through_left = (
        partial(reflected, point_mm=hinge, normal=np.array([side * math.sin(tilt), 0.0, -math.cos(tilt)]))
        for side in (-1.0, 1.0)
    )
    box = np.array([-60.0, -40.0, -420.0]), np.array([60.0, 40.0, -200.0])
    detection = detection_of((MIRRORED_RIGHT, MIRRORED_LEFT), (through_right, through_left), box, 2)
    solution = solve(detection, BOARD, model="one-lens")
    assert solution.rms_px == pytest.approx(0.28, abs=0.015)
    assert solution.calibration.baseline == pytest.approx(400 * math.sin(math.radians(16)), abs=0.5)


def test_two_views_in_alternate_rows_share_one_lens_too() -> None:
    """An interlaced adapter: the left eye in the even rows, one 60 mm to its right in the odd ones."""
    even, odd = (View(left=0.0, top=0.0, width=1.0, height=1.0, row_start=start, row_step=2) for start in (0, 1))
    eye = np.array([60.0, 0.0, 0.0])
    box = np.array([-60.0, -50.0, 350.0]), np.array([120.0, 50.0, 520.0])
    detection = detection_of((even, odd), (np.asarray, lambda points: points - eye), box, 3)
    model = one_lens.model((even, odd), 1280, 720)
    seed = one_lens.seed(BOARD.points(), detection.pixels(), (even, odd), 1280, 720)
    found = fit_frames(detection, BOARD, Start(model, (seed,), None)).unknowns
    focal_px, cx_px, cy_px, _, _ = found.lens
    assert np.linalg.norm(found.others[0].t) == pytest.approx(60.0, abs=0.2)
    assert focal_px == pytest.approx(LENS.fx_px, rel=5e-3)
    assert cx_px == pytest.approx(LENS.cx_px, abs=3)
    assert cy_px == pytest.approx(LENS.cy_px, abs=3)
    left, right = model.lenses(found.lens)
    assert left.fy_px == pytest.approx(focal_px / 2, rel=1e-9)
    assert right.cy_px == pytest.approx(left.cy_px - 0.5, abs=1e-9)


def test_mirroring_the_whole_frame_gives_the_same_answer(oak: Rig) -> None:
    """A driver that flips the picture: both views stand mirrored, in each other's half."""
    detection = traced_detection(oak, 2)
    flip = np.array([-1.0, 1.0]), np.array([1279.0, 0.0])
    views = (MIRRORED_LEFT, MIRRORED_RIGHT)
    flipped = tuple(
        Sighting.of(
            pair.name,
            *(
                view.upright_from_raw(corners * flip[0] + flip[1], 1280, 720)
                for view, corners in zip(views, (pair.left, pair.right), strict=True)
            ),
        )
        for pair in detection.sightings
    )
    board = Board(9, 7, SQUARE_MM)
    plain = solve(detection, board, model="one-lens").calibration
    mirrored = solve(Detection(1280, 720, views, flipped), board, model="one-lens").calibration
    assert mirrored.baseline == pytest.approx(plain.baseline, rel=1e-6)
    assert mirrored.left.lens.fx_px == pytest.approx(plain.left.lens.fx_px, rel=1e-6)
    np.testing.assert_allclose(mirrored.right.R_camera_from_left, plain.right.R_camera_from_left, atol=1e-7)
    assert mirrored.left.lens.cx_px == pytest.approx(plain.left.lens.cx_px - 640, abs=1e-3)  # the half it stands in
