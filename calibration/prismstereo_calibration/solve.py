"""Solve a calibration: corner pairs in, two virtual cameras out, and an account of how well they fit.

The start comes from the rig, or from the views themselves; `fit` does the work; what comes out is held against the rig,
because a wrong rig or a wrong size of square fits the pixels just as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration import one_lens, two_camera
from prismstereo_calibration.board import Board
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.detection import Detection, Rejection
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.fit import Fit, Start, fit_frames, require_frames
from prismstereo_calibration.model import Calibration, Model
from prismstereo_calibration.poses import Pose, rotation
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import LAYOUTS

__all__ = ["Solution", "solve"]

Array = NDArray[np.float64]

_LABELS = 128
_NEAREST_SLACK = 1.001
_MOST_FOCAL_SIGMA = 0.1  # of the focal length
_MOST_OFF_RIG = 0.25  # a mount is built to a few per cent; beyond this it is another rig or another square


@dataclass(frozen=True, slots=True)
class Solution:
    """A calibration and its account; arrays are in the order of `used`, left view before right.

    `rms_px` is per two-dimensional point over both views, as `cv2.stereoCalibrate` reports it; a noise of s px per axis
    reads s times the square root of two. Board poses take board points to the left camera. The sigmas are one standard
    deviation, from the residuals themselves.
    """

    calibration: Calibration
    rms_px: float
    rms_left_px: float
    rms_right_px: float
    frame_rms_px: Array  # (V,) both views together
    used: tuple[str, ...]
    rejected: tuple[Rejection, ...]
    corners_px: Array  # (V, 2, N, 2) upright
    residuals_px: Array  # (V, 2, N, 2) projected minus measured
    R_left_from_board: Array  # (V, 3, 3)
    t_left_from_board: Array  # (V, 3) in the calibration's unit
    focal_sigma_px: float
    baseline_sigma: float  # in the calibration's unit


def solve(
    detection: Detection,
    board: Board,
    *,
    rig: Rig | None = None,
    model: Model | None = None,
    wish: RangeWish | None = None,
    lens_position: int | None = None,
) -> Solution:
    """Solve for the two virtual cameras that the detected corners show.

    With a rig the model is one-lens unless told otherwise, or unless its glass asks for more, and starts from the rig's
    nominal cameras; without one it is two-camera. The range is `wish`, else the rig's, else all that 128 labels reach; a
    wish in mm needs a board of known squares (`UsageError`). `CalibrationError` where too few frames fit, where they do not
    determine the cameras, and where they contradict the rig.
    """
    if wish is not None and board.unit == "square":
        raise UsageError("a range in mm needs the size of the board's squares: measure one and pass --square-mm")
    start = _start(detection, board, rig, model or _default_model(rig))
    fit = fit_frames(detection, board, start)
    calibration = _calibration(fit, board, start, rig)
    _require_rig(calibration, rig)
    wish = wish or _range(calibration, rig)
    return _account(replace(calibration, range=wish, lens_position=lens_position), start, fit)


def _account(calibration: Calibration, start: Start, fit: Fit) -> Solution:
    """Put a calibration and what is left over of its fit together."""
    used = tuple(pair.name for pair in fit.detection.sightings)
    square = np.sum(fit.residuals_px**2, axis=-1)
    left_px, right_px = np.sqrt(square.mean(axis=(0, 2)))
    rms_px = float(np.sqrt(square.mean()))
    return Solution(
        calibration=replace(calibration, rms_px=rms_px, views_used=len(used)),
        rms_px=rms_px,
        rms_left_px=float(left_px),
        rms_right_px=float(right_px),
        frame_rms_px=np.sqrt(square.mean(axis=(1, 2))),
        used=used,
        rejected=fit.rejected,
        corners_px=fit.detection.pixels(),
        residuals_px=fit.residuals_px,
        R_left_from_board=fit.unknowns.R_left_from_board,
        t_left_from_board=fit.unknowns.t_left_from_board,
        focal_sigma_px=_focal_sigma(start, fit),
        baseline_sigma=_baseline_sigma(fit),
    )


def _default_model(rig: Rig | None) -> Model:
    """One lens behind a rig, unless its glass distorts each view in its own way; two cameras without one."""
    return "two-camera" if rig is None or rig.own_lens_per_view else "one-lens"


def _start(detection: Detection, board: Board, rig: Rig | None, name: Model) -> Start:
    views, width, height = detection.views, detection.frame_width, detection.frame_height
    model = one_lens.model(views, width, height) if name == "one-lens" else two_camera.model()
    require_frames(len(detection.sightings), model, detection.rejected)
    if rig is not None:
        left, right, pose = _promise(rig, detection)
        return Start(model, (model.own(left, right),), pose if board.unit == "mm" else None)
    points, pixels = board.points(), detection.pixels()
    if name == "one-lens":
        return Start(model, (one_lens.seed(points, pixels, views, width, height),), None)
    return Start(model, two_camera.seeds(points, pixels, views, width, height), None)


def _promise(rig: Rig, detection: Detection) -> tuple[Lens, Lens, Pose]:
    """Return the lenses of the rig's views on frames of this size and the pose it promises; refuse other frames."""
    if detection.views != rig.views:
        raise UsageError(f"the views are not those of rig {rig.name!r}: leave --layout out where a rig is given")
    size = detection.frame_width, detection.frame_height
    nominal = Calibration.nominal(rig)
    pose = Pose(nominal.right.R_camera_from_left, nominal.right.t_camera_from_left)
    video, still = rig.camera.video, rig.camera.still
    left, right = nominal.left.lens, nominal.right.lens
    if size == (video.width, video.height):
        return left, right, pose
    if size == (still.width, still.height):  # as wide a field on another grid, and taller
        left, right = (
            replace(lens.scaled(still.width / video.width), cy_px=rig.lens(still).cy_px) for lens in (left, right)
        )
        return left, right, pose
    raise CalibrationError(
        f"the frames are {size[0]}x{size[1]}, but rig {rig.name!r} takes {video.width}x{video.height} (video) and "
        f"{still.width}x{still.height} (stills): give frames as the camera delivers them, or another rig"
    )


def _calibration(fit: Fit, board: Board, start: Start, rig: Rig | None) -> Calibration:
    detection, right = fit.detection, fit.unknowns.right
    left_lens, right_lens = start.model.lenses(fit.unknowns.lens)
    layout = next((name for name, views in LAYOUTS.items() if views == detection.views), "own layout")
    return Calibration(
        rig=layout if rig is None else rig.name,
        frame_width=detection.frame_width,
        frame_height=detection.frame_height,
        left_view=detection.views[0],
        right_view=detection.views[1],
        left=Camera.at_origin(left_lens),
        right=Camera(right_lens, rotation(right.R), right.t),
        range=RangeWish(near_mm=1.0, far_mm=np.inf, labels=_LABELS),  # until the baseline is known
        model="one-lens" if start.model.name == "one-lens" else "two-camera",
        unit=board.unit,
    )


def _require_rig(calibration: Calibration, rig: Rig | None) -> None:
    """Refuse a result that is far from what the rig promises: both fit the pixels, only one is right."""
    if rig is None:
        return
    nominal = Calibration.nominal(rig)
    scale = calibration.frame_width / rig.camera.video.width
    found_px, promised_px = calibration.left.lens.fx_px, nominal.left.lens.fx_px * scale
    if abs(found_px / promised_px - 1) > _MOST_OFF_RIG:
        raise CalibrationError(
            f"the frames say a focal length of {found_px:.0f} px, rig {rig.name!r} one of {promised_px:.0f}: give the rig "
            "that took them (camera.hfov_deg), or --layout instead of --rig"
        )
    if calibration.unit == "mm" and abs(calibration.baseline / nominal.baseline - 1) > _MOST_OFF_RIG:
        raise CalibrationError(
            f"the frames say a baseline of {calibration.baseline:.1f} mm, rig {rig.name!r} one of {nominal.baseline:.1f}: "
            "measure the board's squares again (--square-mm), or give the rig that took the frames"
        )


def _range(calibration: Calibration, rig: Rig | None) -> RangeWish:
    """Return the rig's range where it is in this unit, else what the labels reach, up to infinity."""
    if rig is not None and calibration.unit == "mm":
        return rig.range
    scale = calibration.focal_px * calibration.baseline
    near = scale / (_LABELS - 2 - 1) * _NEAREST_SLACK
    window = DisparityWindow.between(scale, near, np.inf, _LABELS)
    return RangeWish(near_mm=near, far_mm=np.inf, labels=window.labels)


def _focal_sigma(start: Start, fit: Fit) -> float:
    index = start.model.focal_index
    variance, focal = float(fit.covariance[index, index]), float(fit.unknowns.lens[index])
    if not 0 <= variance < (_MOST_FOCAL_SIGMA * focal) ** 2:
        sigma = math.sqrt(variance) if variance >= 0 else math.nan
        raise CalibrationError(
            f"the frames leave the focal length at {focal:.0f} +- {sigma:.0f} px: tilt the board 20 to 40 degrees in "
            "different directions, near and far"
        )
    return math.sqrt(variance)


def _baseline_sigma(fit: Fit) -> float:
    along = fit.unknowns.right.t / np.linalg.norm(fit.unknowns.right.t)
    return math.sqrt(max(float(along @ fit.covariance[-3:, -3:] @ along), 0.0))
