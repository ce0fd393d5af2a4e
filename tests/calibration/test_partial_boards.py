"""Boards of which every view shows only a part, boards that bend, and rigs of three views, through the same solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.traced_boards import SQUARE_MM, TracedView, paraxial_baseline_mm, traced_detection, turn
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Sighting
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.judging.quality import judge
from prismstereo_calibration.solving.bundle import warp_shapes
from prismstereo_calibration.solving.poses import rotations
from prismstereo_calibration.solving.solve import Options, solve
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import View

Array = NDArray[np.float64]
LARGE = Board.parse("charuco:17x12", 15.0)
BOARD = Board(9, 7, SQUARE_MM)


def partly_seen(rig: Rig, seed: int, poses: int = 12) -> Detection:
    """A board larger than the views, so that none shows all of it; at least a dozen corners in each."""
    random = np.random.default_rng(seed)
    flat = LARGE.points() - LARGE.points().mean(axis=0)
    views = TracedView(rig, "left"), TracedView(rig, "right")
    sightings: list[Sighting] = []
    for _ in range(400):
        points = flat @ turn(random, 30.0).T + np.array([*random.uniform(-60, 60, 2), random.uniform(230, 420)])
        pixels = np.stack([view.pixels(points) for view in views])
        seen = np.isfinite(pixels[..., 0])
        if seen.sum(axis=1).min() >= 12 and not seen.all():
            noisy = pixels + random.normal(0, 0.2, pixels.shape)
            sightings.append(Sighting(f"{len(sightings)}.png", noisy))
        if len(sightings) == poses:
            return Detection(1280, 720, rig.views, tuple(sightings))
    raise AssertionError(f"only {len(sightings)} of {poses} boards are seen well enough")


def test_parts_of_a_board_calibrate_as_well_as_whole_ones(oak: Rig) -> None:
    detection = partly_seen(oak, 4)
    unseen = ~np.isfinite(detection.pixels()[..., 0])
    assert unseen.any(axis=(1, 2)).all()  # no frame shows all of it
    solution = solve(detection, LARGE, rig=oak)
    assert solution.rms_px == pytest.approx(0.28, abs=0.015)
    assert solution.calibration.baseline == pytest.approx(paraxial_baseline_mm(oak), abs=0.08)
    left_out = np.isnan(solution.residuals_px[..., 0]) & ~unseen  # one in 270 000 is out of the noise by chance
    assert np.count_nonzero(left_out) == len(solution.rejected_corners) <= 2
    assert judge(solution.calibration, detection, LARGE).triangulation_gap.mean < 0.15


def bent(detection: Detection, rig: Rig, warp_mm: tuple[float, float]) -> Detection:
    """The same poses of a board whose middle stands off its plane by so much."""
    flat = BOARD.points()
    raised = flat + warp_shapes(flat) @ np.array(warp_mm)[:, None] * np.array([0.0, 0.0, 1.0])
    solution = solve(detection, BOARD, rig=rig)
    random = np.random.default_rng(6)
    sightings = []
    for name, R, t in zip(solution.used, solution.R_left_from_board, solution.t_left_from_board, strict=True):
        points = raised @ R.T + t
        pixels = [camera.project(points) for camera in (solution.calibration.left, solution.calibration.right)]
        sightings.append(Sighting.of(name, *(seen + random.normal(0, 0.2, seen.shape) for seen in pixels)))
    return replace(detection, sightings=tuple(sightings))


def test_a_bent_board_is_found_out_and_does_no_harm(oak: Rig) -> None:
    detection = bent(traced_detection(oak, 2), oak, (0.6, -0.3))
    solution = solve(detection, BOARD, rig=oak)
    assert solution.warp == pytest.approx([0.6, -0.3], abs=0.06)
    assert solution.rms_px == pytest.approx(0.28, abs=0.015)
    assert solution.calibration.baseline == pytest.approx(paraxial_baseline_mm(oak), abs=0.12)
    stiff = solve(detection, BOARD, rig=oak, options=Options(warped=False))
    assert stiff.warp is None
    assert stiff.rms_px > 0.32


def test_a_flat_board_is_not_taken_for_a_bent_one(oak: Rig) -> None:
    assert solve(traced_detection(oak, 5), BOARD, rig=oak).warp is None


def test_a_lens_that_bends_more_asks_for_more_numbers(oak: Rig) -> None:
    camera = solve(traced_detection(oak, 1), BOARD, rig=oak).calibration
    true = replace(camera.left.lens, distortion=(-0.06, 0.03, 4e-3, -3e-3, 0.02))
    left = Camera.at_origin(true, camera.left.plate)
    right = replace(camera.right, lens=true)
    solution = solve(traced_detection(oak, 1), BOARD, rig=oak)
    random = np.random.default_rng(8)
    sightings = []
    for name, R, t in zip(solution.used, solution.R_left_from_board, solution.t_left_from_board, strict=True):
        seen = [each.project(BOARD.points() @ R.T + t) for each in (left, right)]
        sightings.append(Sighting.of(name, *(pixels + random.normal(0, 0.2, pixels.shape) for pixels in seen)))
    detection = Detection(1280, 720, oak.views, tuple(sightings))
    found = solve(detection, BOARD, rig=oak, options=Options(full=True))
    assert found.rms_px == pytest.approx(0.28, abs=0.015)
    assert found.calibration.left.lens.distortion[2:4] == pytest.approx((4e-3, -3e-3), abs=1e-3)
    assert solve(detection, BOARD, rig=oak).rms_px > found.rms_px + 0.01


THIRDS = tuple(View(left=start, top=0.0, width=0.333, height=1.0) for start in (0.0, 0.333, 0.666))


def three_views(seed: int) -> tuple[Detection, tuple[Array, ...]]:
    """One lens behind mirrors that give three viewpoints in a row, 50 and 90 mm from the first; some frames lack the third."""
    lens = Lens(1500.0, 1500.0, 636.0, 352.0, (-0.05, 0.02, 0.0, 0.0, 0.0))
    centres = np.array([[0.0, 0, 0], [50.0, 0, 0], [90.0, 2.0, 1.0]])
    turns = [rotations(np.array([0.0, angle, 0.0])) for angle in (-0.28, 0.0, 0.27)]  # each into its third of the frame
    cameras = [Camera(lens, R, -R @ centre) for R, centre in zip(turns, centres, strict=True)]
    random, sightings = np.random.default_rng(seed), []
    flat = BOARD.points() * 0.5 - BOARD.points().mean(axis=0) * 0.5
    for _ in range(4000):
        R, middle = rotations(random.uniform(-0.5, 0.5, 3)), [random.uniform(0, 90), random.uniform(-80, 80), 700.0]
        points = flat @ R.T + np.array(middle) + random.uniform(-120, 120) * np.array([0, 0, 1.0])
        pixels = np.stack([camera.project(points) for camera in cameras])
        for index, view in enumerate(THIRDS):
            x, y, w, h = view.rectangle(1280, 720)
            inside = ((pixels[index] > [x, y]) & (pixels[index] < [x + w, y + h])).all()
            pixels[index] = pixels[index] if inside else np.nan
        if np.isfinite(pixels[0]).all() and np.isfinite(pixels[1:]).any():
            sightings.append(Sighting(f"{len(sightings)}.png", pixels + random.normal(0, 0.2, pixels.shape)))
        if len(sightings) == 12:
            return Detection(1280, 720, THIRDS, tuple(sightings)), tuple(centres)
    raise AssertionError(f"only {len(sightings)} of 12 boards fit the views")


def test_three_views_of_one_lens_are_solved_together() -> None:
    detection, centres = three_views(3)
    unseen = np.isnan(detection.pixels()[:, 1:, 0, 0])
    assert unseen.any()
    half = Board(9, 7, SQUARE_MM / 2)
    solution = solve(detection, half, model="one-lens")
    (third,) = solution.others
    assert solution.rms_px == pytest.approx(0.28, abs=0.02)
    assert solution.calibration.baseline == pytest.approx(50.0, abs=1.0)
    assert third.baseline == pytest.approx(float(np.linalg.norm(centres[2])), abs=1.5)
    assert third.right_view == THIRDS[2]
    assert third.left.lens == solution.calibration.left.lens


def test_a_view_that_never_shows_the_board_is_named() -> None:
    detection, _ = three_views(3)
    pixels = detection.pixels()
    pixels[:, 2] = np.nan
    blind = replace(detection, sightings=tuple(Sighting(str(i), seen) for i, seen in enumerate(pixels)))
    with pytest.raises(CalibrationError, match="in view 3"):
        solve(blind, Board(9, 7, SQUARE_MM / 2), model="one-lens")
