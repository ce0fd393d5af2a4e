"""Real boards that nobody here photographed: two rigs of two cameras, from pictures to figures.

The bounds are published or measured figures with a little slack. PRISMSTEREO_DATA names the folder.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detect import detect
from prismstereo_calibration.boards.detection import Detection, NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.judging.quality import judge
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.solving.solve import Options, solve
from prismstereo_hw.view import layout

BOARD = Board(9, 6)


@cache
def stereopi_frames(folder: Path) -> tuple[NamedFrame, ...]:
    """24 side-by-side frames of 640x240 of a StereoPi."""
    return tuple(
        NamedFrame(path.name, np.asarray(cv2.imread(str(path)), np.uint8))
        for path in sorted(folder.glob("sbs-stereopi-320/*.png"))
    )


def right_of(path: Path) -> Path:
    """The right picture beside a left one."""
    return path.with_name(path.name.replace("left", "right"))


@cache
def opencv_frames(folder: Path) -> tuple[NamedFrame, ...]:
    """13 pairs of OpenCV's own samples, put side by side."""
    return tuple(
        NamedFrame(
            path.name,
            np.hstack([cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in (path, right_of(path))]),
        )
        for path in sorted(folder.glob("calib-opencv-9x6/left*.jpg"))
    )


@cache
def stereopi(folder: Path) -> Detection:
    return detect(stereopi_frames(folder), layout("side-by-side"), BOARD)


def test_stereopi_frames_solve_to_a_fifth_of_a_pixel(data: Path) -> None:
    detection = stereopi(data)
    solution = solve(detection, BOARD)
    assert (len(solution.used), solution.rejected) == (24, ())
    assert solution.rms_px <= 0.22  # measured 0.186
    assert solution.calibration.baseline == pytest.approx(2.295, abs=0.01)
    assert solution.calibration.left.lens.fx_px == pytest.approx(301.5, abs=2)
    turn = np.degrees(np.linalg.norm(cv2.Rodrigues(solution.calibration.right.R_camera_from_left)[0]))
    assert turn == pytest.approx(1.2, abs=0.3)  # it trades with the principal points
    quality = judge(solution.calibration, detection, BOARD, rms_px=solution.rms_px)
    assert quality.unit == "square"
    assert quality.plane_fit.rms <= 0.045  # of a square, at 5 to 9 squares distance; measured 0.037
    assert quality.row_error.mean_px <= 0.10  # measured 0.076
    assert quality.verdict == "good"


def test_opencv_pairs_solve_to_their_known_baseline(data: Path) -> None:
    detection = detect(opencv_frames(data), layout("side-by-side"), BOARD)
    solution = solve(detection, BOARD)
    assert len(solution.used) == 13
    assert solution.rms_px <= 0.25  # measured 0.193
    assert solution.calibration.baseline == pytest.approx(3.33, abs=0.03)
    quality = judge(solution.calibration, detection, BOARD, rms_px=solution.rms_px)
    assert quality.plane_fit.rms <= 0.013  # measured 0.010
    assert quality.row_error.mean_px <= 0.14  # the data's own figure; measured 0.099


def test_real_frames_agree_with_opencvs_own_calibration(data: Path) -> None:
    detection = stereopi(data)
    solution = solve(detection, BOARD, options=Options(warped=False))
    left, right = solution.calibration.left.lens, solution.calibration.right.lens
    pixels = detection.pixels().astype(np.float32)
    rms, _, _, _, _, _, t, *_ = cv2.stereoCalibrate(
        [BOARD.points().astype(np.float32)] * len(pixels), list(pixels[:, 0]), list(pixels[:, 1]),
        left.K, np.array(left.distortion), right.K, np.array(right.distortion), (640, 240),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
    )  # fmt: skip
    assert solution.rms_px == pytest.approx(rms, abs=1e-5)
    assert solution.calibration.baseline == pytest.approx(float(np.linalg.norm(t)), abs=1e-4)


def test_half_the_frames_predict_the_other_half(data: Path) -> None:
    """Cross-validation: figures on frames that the solver never saw are those of the frames it did."""
    detection = stereopi(data)
    names = [pair.name for pair in detection.sightings]
    calibration = solve(detection.only(set(names[::2])), BOARD).calibration
    quality = judge(calibration, detection.only(set(names[1::2])), BOARD)
    assert quality.row_error.mean_px <= 0.15
    assert abs(quality.scale_error.mean) <= 0.01
    assert quality.plane_fit.rms <= 0.06


def test_one_lens_does_not_fit_two_cameras_and_the_verdict_says_so(data: Path) -> None:
    detection = stereopi(data)
    solution = solve(detection, BOARD, model="one-lens")
    assert judge(solution.calibration, detection, BOARD, rms_px=solution.rms_px).verdict == "redo"


def test_a_mirrored_half_gives_the_same_answer(data: Path) -> None:
    """The right half's pixels flipped, the view said to be mirrored: detector and solver see what they saw."""
    frames = [NamedFrame(frame.name, frame.pixels.copy()) for frame in stereopi_frames(data)]
    for frame in frames:
        frame.pixels[:, 320:] = frame.pixels[:, 320:][:, ::-1].copy()
    left, right = layout("side-by-side")
    mirrored = type(right)(left=right.left, top=right.top, width=right.width, height=right.height, mirrored=True)
    found = solve(detect(frames, (left, mirrored), BOARD), BOARD)
    plain = solve(stereopi(data), BOARD)
    assert found.rms_px == pytest.approx(plain.rms_px, abs=1e-9)
    assert found.calibration.baseline == pytest.approx(plain.calibration.baseline, abs=1e-9)


@pytest.mark.parametrize("asked", [Board(8, 6), Board(10, 6)])
def test_a_wrong_count_of_corners_on_real_frames_is_named_with_the_flag(data: Path, asked: Board) -> None:
    with pytest.raises(CalibrationError, match=r"found a 9x6 board in left01\.jpg: pass --board chessboard:9x6"):
        detect(opencv_frames(data)[:2], layout("side-by-side"), asked)


def test_exchanged_halves_are_refused(data: Path) -> None:
    with pytest.raises(CalibrationError, match="exchanged"):
        solve(detect(opencv_frames(data), layout("swapped"), BOARD), BOARD)


def test_squares_of_known_size_scale_the_baseline(data: Path) -> None:
    solution = solve(stereopi(data), Board(9, 6, 25.0))
    assert solution.calibration.unit == "mm"
    assert solution.calibration.baseline == pytest.approx(25 * 2.2947, abs=0.1)
    assert math.isinf(solution.calibration.range.far_mm)
    assert rectification(solution.calibration).window.labels == 128  # the range it was given is one that it can search
