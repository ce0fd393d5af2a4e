"""The figures that this camera promises, through the whole chain: twin, sensor noise, rectifying, matching, fitting."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np
import pytest

from calibration.traced_boards import TracedView, traced_detection, turn
from device.test_surfaces import plane
from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.measuring import Patch, Relief, fit_sphere
from prismstereo.measuring.assessment import assess_flat
from prismstereo.measuring.flat_target import FlatFigures, flat_figures
from prismstereo.measuring.frames import MeasuringFrame
from prismstereo.measuring.gap import Gap, board_gap
from prismstereo.measuring.levels import Levels, levels
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.solving.solve import solve
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.rig import Mode, RangeWish, Rig
from prismstereo_hw.scene import Scene, named
from prismstereo_hw.scene import board as drawn_board
from prismstereo_hw.sensor import SensorModel
from prismstereo_hw.shapes.sphere import Sphere as Ball
from prismstereo_hw.shapes.stage import Stage
from prismstereo_hw.twin import Twin

SENSOR = SensorModel()  # photons, read noise and eight bits
PAPER = Rig.read("dslr-35mm")
NEAR = RangeWish(near_mm=300.0, far_mm=1000.0, labels=240)
WIDE = RangeWish(near_mm=380.0, far_mm=np.inf, labels=272)
GAP_MM, PLANE_FIT_MM, MOONSHOT_MM, SUBPIXEL_PX, RADIUS_MM = 0.047, 0.34, 0.20, 0.12, 0.2


@cache
def solved() -> Calibration:
    """A calibration as a factory makes it: boards with 0.2 px of noise per axis, through the exact optics."""
    return solve(traced_detection(PAPER, 7), Board(9, 7, 10.0), rig=PAPER).calibration


def framed(rig: Rig, scene: Scene, calibration: Calibration, wish: RangeWish | None, seed: int = 1) -> ExportFrame:
    """What is matched of a scene."""
    found = Pipeline(calibration, wish=wish).process(Twin(rig, scene, sensor=SENSOR, seed=seed).frame())
    return ExportFrame.of(0, 0, found, None, Geometries(calibration))


def plane_figures(distance_mm: float, turn_deg: float, tip_deg: float, calibration: Calibration) -> FlatFigures:
    found = framed(PAPER, plane(PAPER, distance_mm, turn_deg, tip_deg), calibration, NEAR, round(distance_mm))
    return flat_figures([Relief.of_frame(found)])


def assert_plane(one: FlatFigures) -> None:
    assert one.plane_fit_mm.mean <= MOONSHOT_MM < PLANE_FIT_MM, one
    assert one.plane_rms_mm <= MOONSHOT_MM, one
    assert one.subpixel_rms_px <= SUBPIXEL_PX, one
    assert one.fill_percent >= 95.0, one


def test_a_plane_at_a_foot_is_flat_to_a_fifth_of_a_millimetre() -> None:
    assert_plane(plane_figures(400.0, 15.0, -10.0, Calibration.nominal(PAPER)))


@pytest.mark.soak
def test_planes_at_the_distances_of_the_paper() -> None:
    print(
        f"\n{'plane, dslr-35mm':24}{'distance mm':>12}{'rms mm':>9}{'table 1 mm':>11}{'sub-pixel px':>13}{'fill %':>8}"
    )
    for distance, turned, tipped in (
        (320, 0, 0), (335, 12, 5), (350, -15, 8), (370, 20, -12), (385, -8, -20), (400, 25, 10), (415, -25, -5), (430, 5, 25),
    ):  # fmt: skip
        one = plane_figures(float(distance), float(turned), float(tipped), solved())
        print(f"{f'turned {turned}, tipped {tipped}':24}{one.distance_mm:12.1f}{one.plane_rms_mm:9.4f}"
              f"{one.plane_fit_mm.mean:11.4f}{one.subpixel_rms_px:13.4f}{one.fill_percent:8.2f}")  # fmt: skip
        assert_plane(one)


def corner_gap(poses: int) -> Gap:
    """Board pictures rendered at the paper's distances, corners found in each view by itself, a solved calibration."""
    rng, twins = np.random.default_rng(11), []
    views = TracedView(PAPER, "left"), TracedView(PAPER, "right")
    flat = Board(9, 7, 8.0).points() - np.array([32.0, 24.0, 0.0])
    while len(twins) < poses:
        R, centre = turn(rng, 25.0), np.array([*rng.uniform(-40, 40, 2), rng.uniform(330, 430)])
        if any(np.isnan(view.pixels(flat @ R.T + centre)).any() for view in views):
            continue
        stage = Stage.before(PAPER)
        wall = stage.facing("wall", (0.0, 0.0, 900.0), (np.inf, np.inf), 3)
        shown = drawn_board(9, 7, 8.0, R, centre - R @ np.array([32.0, 24.0, 0.0]))
        twins.append(Twin(PAPER, Scene("board", (shown, wall)), sensor=SENSOR, seed=len(twins)))
    found = board_gap(solved(), [twin.frame(index) for index, twin in enumerate(twins)], Board(9, 7, 8.0))
    assert found is not None
    return found


@pytest.mark.soak
def test_rays_of_corners_meet_at_the_distances_of_the_paper() -> None:
    found = corner_gap(12)
    print(f"\ngap, dslr-35mm, {found.features} corners at {found.distance_mm:.0f} mm: mean {found.mean:.4f} mm, variance "
          f"{found.variance:.6f}, corner noise {found.noise_px:.3f} px")  # fmt: skip
    assert found.mean <= GAP_MM, found


def ball(
    distance_mm: float, calibration: Calibration, seed: int, radius_mm: float = 60.0
) -> tuple[float, float, float]:
    """Radius found, its sigma, and the sub-pixel rms, of a ball whose nearest point is at a distance."""
    stage = Stage.before(PAPER)
    far = distance_mm + radius_mm
    thing = Ball("ball", stage.pose((stage.middle_mm(far), 4.0 * seed, far)), radius_mm, stage.noise(seed, distance_mm))
    wall = stage.facing("wall", (0.0, 0.0, 2 * distance_mm), (np.inf, np.inf), 9)
    found = Relief.of_frame(framed(PAPER, Scene("ball", (thing, wall)), calibration, NEAR, seed))
    near = np.nan_to_num(found.inverse_px) > found.scale_px / far
    rows, columns = np.flatnonzero(near.mean(axis=1) > 0.05), np.flatnonzero(near.mean(axis=0) > 0.05)
    patch = Patch(int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1)
    sphere = fit_sphere(found, patch)
    return sphere.radius.value_mm, sphere.radius.sigma_mm, sphere.rms_px


@pytest.mark.soak
def test_balls_are_measured_by_a_solved_calibration() -> None:
    print()
    for seed in range(6):
        radius, sigma, rms = ball(400.0, solved(), seed)
        print(f"ball of 60 mm at 400 mm, seed {seed}: radius {radius:.4f} +- {sigma:.4f} mm, {rms:.4f} px")
        assert abs(radius - 60.0) <= min(RADIUS_MM, 3 * sigma), (seed, radius, sigma)


def z_accuracy(distance_mm: float, calibration: Calibration) -> FlatFigures:
    """Held against the twin's true depths, which know of no calibration."""
    shown = plane(PAPER, distance_mm, 0.0, 0.0)
    found = framed(PAPER, shown, calibration, WIDE)
    return assess_flat("plane", [MeasuringFrame(found, None, Twin(PAPER, shown).truth())]).figures


@pytest.mark.soak
def test_distances_are_true_to_half_a_per_cent_at_one_metre_and_one_at_two() -> None:
    print()
    for name, calibration in (("nominal", Calibration.nominal(PAPER)), ("solved", solved())):
        for distance, most in ((500.0, 0.5), (1000.0, 0.5), (2000.0, 1.0)):
            one = z_accuracy(distance, calibration)
            print(f"Z accuracy, dslr-35mm, {name}: {one.distance_mm:8.1f} mm {one.z_accuracy_percent:+.4f} %")
            assert one.z_accuracy_percent is not None
            assert abs(one.z_accuracy_percent) <= most, one


def desk_levels() -> Levels:
    """A table from 0.3 m to a wall at 3 m, with boxes on it."""
    rig = Rig.read("oak-1")
    stage = Stage.before(rig)
    shapes = [stage.ground("table", 110.0, 300.0, 1), stage.facing("wall", (0.0, 0.0, 3000.0), (np.inf, np.inf), 2)]
    for index, far in enumerate((450.0, 800.0, 1500.0)):
        shapes.append(stage.facing("box", ((index - 1) * 0.15 * far, 30.0, far), (0.06 * far, 80.0), 3 + index))
    wish = RangeWish(near_mm=290.0, far_mm=3500.0, labels=176)
    return levels([framed(rig, Scene("desk", tuple(shapes)), Calibration.nominal(rig), wish).inverse_px])


@pytest.mark.soak
def test_desk_and_street_use_over_ninety_disparity_levels() -> None:
    """The street is matched on the still's halves, 2376 pixels wide."""
    still = PAPER.camera.still
    mode = Mode(width=still.width, height=still.height, rate_hz=1.0)
    rig = msgspec.structs.replace(PAPER, camera=msgspec.structs.replace(PAPER.camera, video=mode))
    calibration = Calibration.nominal(rig)
    wish = RangeWish(near_mm=2800.0, far_mm=40_000.0, labels=144)
    street, desk = levels([framed(rig, named(rig, "street"), calibration, wish).inverse_px]), desk_levels()
    print(f"\nlevels in use: street {street.in_use} of {street.span} spanned, {rectification(calibration).width} px wide; "
          f"desk {desk.in_use} of {desk.span}")  # fmt: skip
    assert 90 <= street.in_use <= 150
    assert 90 <= desk.in_use <= 150
