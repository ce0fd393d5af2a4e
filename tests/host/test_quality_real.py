"""Real pictures with known truth: depth is off by what disparity is off by, and a board has the size that was printed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.measuring import Patch, Relief, distance, fit_plane
from prismstereo.measuring.truth_bins import TruthBin, truth_bins
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detect import detect
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.solve import solve
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw import pfm
from prismstereo_hw.files import read_picture
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish
from prismstereo_hw.view import layout

SQUARE_MM = 25.0  # as good as any: nobody published it


def parallel(
    shape: tuple[int, int], focal_px: float, centre_px: tuple[float, float], baseline_mm: float, labels: int
) -> Calibration:
    """Two like cameras side by side, whose pictures are rectified already."""
    height, width = shape
    left = Lens(focal_px, focal_px, centre_px[0], centre_px[1])
    right = replace(left, cx_px=centre_px[0] + width)
    views = layout("side-by-side")
    return Calibration(
        rig="two cameras", frame_width=2 * width, frame_height=height, left_view=views[0], right_view=views[1],
        left=Camera.at_origin(left), right=Camera(right, np.eye(3), np.array([-baseline_mm, 0.0, 0.0])),
        range=RangeWish(near_mm=1000.0, far_mm=np.inf, labels=labels), model="two-camera",
    )  # fmt: skip


def held_against(
    left: Path, right: Path, true_px: np.ndarray, calibration: Calibration
) -> tuple[tuple[TruthBin, ...], float, float]:
    """Bins of the whole chain's depth against focal length x baseline / true disparity; and the fit found = a true + b px."""
    frame = RawFrame(np.hstack([read_picture(path, grey=True) for path in (left, right)]), 0)
    pipeline = Pipeline(calibration)
    relief = Relief.of_frame(ExportFrame.of(0, 0, pipeline.process(frame), None, Geometries(calibration)))
    made = pipeline.rectifier.rectification
    source = made.sources(made.left)
    true = cv2.remap(true_px, source[..., 0], source[..., 1], cv2.INTER_LINEAR, borderValue=float("nan"))
    focal_px, baseline_mm = calibration.left.lens.fx_px, calibration.baseline
    bins = truth_bins(relief.scale_px / relief.inverse_px, focal_px * baseline_mm / true, focal_px * baseline_mm)
    off = relief.inverse_px - true
    good = np.abs(np.nan_to_num(off, nan=9.0)) < 1
    slope, offset = np.polyfit(true[good], relief.inverse_px[good], 1)
    return bins, float(slope), float(offset)


def assert_as_predicted(name: str, bins: tuple[TruthBin, ...], slope: float) -> None:
    assert len(bins) >= 4
    for one in bins:
        if one.errors is None or one.pixels < 2000:
            continue
        found = one.errors
        print(f"{name:14}{one.from_mm:6.0f} to {one.to_mm:6.0f} mm  {found.disparity_rms_px:.3f} px {found.depth_rms_mm:9.2f}"
              f" mm, predicted {found.predicted_rms_mm:9.2f}, bias {found.disparity_bias_px:+.3f} px")  # fmt: skip
        assert found.depth_rms_mm == pytest.approx(found.predicted_rms_mm, rel=0.15), one
        assert abs(found.disparity_bias_px) <= 0.3, one
    assert slope == pytest.approx(1.0, abs=0.02)


def test_a_terrace_stands_where_the_laser_saw_it(data: Path) -> None:
    folder = data / "gt-eth3d-terrace"
    true = pfm.read_disparity(folder / "disp0.pfm")
    calibration = parallel((434, 713), 711.499, (376.135, 227.447), 59.9432, 32)
    bins, slope, offset = held_against(folder / "im0.png", folder / "im1.png", true, calibration)
    assert_as_predicted("terrace", bins, slope)
    assert abs(offset) <= 0.25


@pytest.mark.parametrize(
    ("name", "left", "right", "truth", "steps", "focal_px"),
    [
        ("teddy", "im2", "im6", "disp2", 4, 900.0),  # its focal length was not published: any will do for the law
        ("moebius_third", "view1", "view5", "disp1", 3, 3740 / 3),
    ],
)
def test_depth_of_middlebury_scenes_is_off_by_what_their_disparity_is(
    data: Path, name: str, left: str, right: str, truth: str, steps: int, focal_px: float
) -> None:
    folder = data / "gt-middlebury" / name
    coded = read_picture(folder / f"{truth}.png", grey=True).astype(np.float32)
    true = np.where(coded == 0, np.nan, coded / steps).astype(np.float32)
    height, width = true.shape
    calibration = parallel((height, width), focal_px, ((width - 1) / 2, (height - 1) / 2), 160.0, 96)
    bins, slope, _ = held_against(folder / f"{left}.png", folder / f"{right}.png", true, calibration)
    assert_as_predicted(name, bins, slope)


@pytest.mark.soak
def test_a_printed_board_is_flat_and_its_squares_have_their_size(data: Path) -> None:
    """Calibrated on every other frame, measured in the dense depth of the others, across 8 and 5 squares."""
    board = Board(9, 6, SQUARE_MM)
    paths = sorted((data / "sbs-stereopi-320").glob("*.png"))
    frames = [NamedFrame(path.name, np.asarray(cv2.imread(str(path)), np.uint8)) for path in paths]
    found = detect(frames, layout("side-by-side"), board)
    solution = solve(found.only([path.name for path in paths[::2]]), board)
    calibration = solution.calibration
    pipeline = Pipeline(calibration, wish=RangeWish(near_mm=100.0, far_mm=2000.0, labels=208))
    made, geometries = pipeline.rectifier.rectification, Geometries(calibration)
    errors, flatness = [], []
    for sighting in found.sightings[1::2]:
        pixels = next(frame.pixels for frame in frames if frame.name == sighting.name)
        shown = Relief.of_frame(ExportFrame.of(0, 0, pipeline.process(RawFrame(pixels, 0)), None, geometries))
        corners = made.rectify(sighting.left, made.left).reshape(6, 9, 2)
        low, high = corners.min(axis=(0, 1)).astype(int), corners.max(axis=(0, 1)).astype(int)
        plane = fit_plane(shown, Patch(int(low[0]), int(low[1]), *map(int, high - low)))
        flatness.append(plane.rms_px)
        for first, second, squares in [((r, 0), (r, 8), 8) for r in range(6)] + [((0, c), (5, c), 5) for c in range(9)]:
            errors.append(
                distance(shown, tuple(corners[first]), tuple(corners[second])).value_mm / (squares * SQUARE_MM) - 1
            )
    print(f"\nstereopi: {len(errors)} lengths, mean error {100 * np.mean(errors):+.3f} %, spread {100 * np.std(errors):.3f} %, "
          f"plane rms {np.median(flatness):.3f} px")  # fmt: skip
    assert abs(np.mean(errors)) <= 0.01
    assert np.median(np.abs(errors)) <= 0.01
    assert np.median(flatness) <= 0.3
