"""Solve a calibration: corner pairs in, two virtual cameras out, and an account of how well they fit.

The start comes from the rig, or from the views themselves; `fit` does the work; what comes out is held against the rig,
because a wrong rig or a wrong size of square fits the pixels just as well.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Rejection
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration, Model
from prismstereo_calibration.nominal import nominal_plate
from prismstereo_calibration.plate import Plate
from prismstereo_calibration.solving import one_lens, two_camera
from prismstereo_calibration.solving.bundle import adjust
from prismstereo_calibration.solving.fit import Fit, RejectedCorner, Start, fit_frames, require_frames
from prismstereo_calibration.solving.poses import Pose, rotation
from prismstereo_calibration.uncertainty import NUMBERS, Uncertainty
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import LAYOUTS

__all__ = ["Options", "Solution", "solve"]

Array = NDArray[np.float64]

_LABELS = 128
_NEAREST_SLACK = 1.001
_MOST_FOCAL_SIGMA = 0.1  # of the focal length
_FEWEST_TO_BEND = 5  # frames: with fewer, a bend and a tilt look alike
_CLEAR_BEND = 6.0  # sigmas
_MOST_OFF_RIG = 0.25  # a mount is built to a few per cent; beyond this it is another rig or another square


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked of the model beside its name; None leaves it to the rig and to the frames.

    `glass`: the rig's plate stands before the lens; by default where the rig has one and lengths are in mm. `full`: p1, p2, k3
    too; by default for two cameras, as far as the frames determine them. `warped`: the board may bend; by default where the
    frames show it beyond doubt.
    """

    glass: bool | None = None
    full: bool | None = None
    warped: bool | None = None


@dataclass(frozen=True, slots=True)
class Solution:
    """A calibration and its account; arrays are in the order of `used`, the views in that of the detection.

    `rms_px` is per two-dimensional point over all views, as `cv2.stereoCalibrate` reports it; a noise of s px per axis
    reads s times the square root of two. Board poses take board points to the left camera. The sigmas are one standard
    deviation, from the residuals themselves. `others` are the calibrations of the left view with any third view and so on.
    `warp`: how far the board's middle stands off its plane by a bend along x and y, in its unit; None for a flat board.
    """

    calibration: Calibration
    rms_px: float
    rms_left_px: float
    rms_right_px: float
    frame_rms_px: Array  # (V,) all views together
    used: tuple[str, ...]
    rejected: tuple[Rejection, ...]
    corners_px: Array  # (V, K, N, 2) upright, NaN where unseen or rejected
    residuals_px: Array  # (V, K, N, 2) projected minus measured
    R_left_from_board: Array  # (V, 3, 3)
    t_left_from_board: Array  # (V, 3) in the calibration's unit
    focal_sigma_px: float
    baseline_sigma: float  # in the calibration's unit
    others: tuple[Calibration, ...] = ()
    rejected_corners: tuple[RejectedCorner, ...] = ()
    warp: Array | None = None
    rounds: int = 0


def solve(
    detection: Detection,
    board: Board,
    *,
    rig: Rig | None = None,
    model: Model | None = None,
    wish: RangeWish | None = None,
    options: Options | None = None,
    lens_position: int | None = None,
    temperature_c: float | None = None,
) -> Solution:
    """Solve for the virtual cameras that the detected corners show.

    With a rig the model is one-lens unless told otherwise, or unless its glass asks for more, and starts from the rig's
    nominal cameras; without one it is two-camera. The range is `wish`, else the rig's, else all that 128 labels reach; a
    wish in mm needs a board of known squares (`UsageError`). `CalibrationError` where too few frames fit, where they do not
    determine the cameras, and where they contradict the rig.
    """
    if wish is not None and board.unit == "square":
        raise UsageError("a range in mm needs the size of the board's squares: measure one and pass --square-mm")
    options = options or Options()
    name = model or _default_model(rig)
    start, fit, found = _solved(detection, board, rig, name, options)
    _require_rig(found[0], rig)
    settled = [
        replace(one, range=wish or _range(one, rig), lens_position=lens_position, temperature_c=temperature_c)
        for one in found
    ]
    return _account(settled, start, fit)


def _fitted(detection: Detection, board: Board, rig: Rig | None, name: Model, options: Options) -> tuple[Start, Fit]:
    start = _start(detection, board, rig, name, options)
    return _bent_if_so(detection, board, start, fit_frames(detection, board, start), options)


def _solved(
    detection: Detection, board: Board, rig: Rig | None, name: Model, options: Options
) -> tuple[Start, Fit, tuple[Calibration, ...]]:
    """Fit, and where two lenses of their own come out like no lens, fit fewer numbers, then the poses alone."""
    tries = [options] if name == "one-lens" or options.full is not None else [options, replace(options, full=False)]
    failure: CalibrationError | None = None
    for option in tries:
        start, fit = _fitted(detection, board, rig, name, option)
        try:
            return start, fit, _calibrations(start, fit, board, rig)
        except CalibrationError as error:
            failure = failure or error
    assert failure is not None
    if name == "one-lens" or rig is not None:
        raise failure
    for plain in (False, True):
        sizes = detection.views, detection.frame_width, detection.frame_height
        alone = Start(two_camera.settled(board.points(), detection.pixels(), *sizes, plain=plain), (np.zeros(0),), None)
        fit = fit_frames(detection, board, alone)
        with contextlib.suppress(CalibrationError):
            return alone, fit, _calibrations(alone, fit, board, rig)
    raise failure


def _calibrations(start: Start, fit: Fit, board: Board, rig: Rig | None) -> tuple[Calibration, ...]:
    """Return the calibration of the left view with each of the others."""
    return tuple(_calibration(fit, board, start, rig, view) for view in range(1, len(fit.detection.views)))


def _bent_if_so(detection: Detection, board: Board, start: Start, flat: Fit, options: Options) -> tuple[Start, Fit]:
    """Return the fit of a board that may bend, if that is asked for or the frames show the bend beyond doubt."""
    if options.warped is False or (options.warped is None and len(flat.detection.sightings) < _FEWEST_TO_BEND):
        return start, flat
    bending = replace(start, model=replace(start.model, warped=True), lenses=(flat.unknowns.lens,))
    pixels = flat.detection.pixels()
    try:
        minimum = adjust(bending.model, board.points(), pixels, flat.unknowns)
    except np.linalg.LinAlgError:
        return start, flat
    warp, spread = minimum.state.warp, minimum.covariance[-2:, -2:]
    clear = np.isfinite(spread).all() and warp @ np.linalg.pinv(spread) @ warp > _CLEAR_BEND**2
    if options.warped or clear:
        return bending, fit_frames(detection, board, bending)
    return start, flat


def _account(calibrations: list[Calibration], start: Start, fit: Fit) -> Solution:
    """Put a calibration and what is left over of its fit together."""
    used = tuple(one.name for one in fit.detection.sightings)
    square = np.sum(fit.residuals_px**2, axis=-1)
    by_view_px = np.sqrt(np.nanmean(square, axis=(0, 2)))
    rms_px = float(np.sqrt(np.nanmean(square)))
    first, *others = (replace(one, rms_px=rms_px, views_used=len(used)) for one in calibrations)
    return Solution(
        calibration=first,
        rms_px=rms_px,
        rms_left_px=float(by_view_px[0]),
        rms_right_px=float(by_view_px[1]),
        frame_rms_px=np.sqrt(np.nanmean(square, axis=(1, 2))),
        used=used,
        rejected=fit.rejected,
        corners_px=fit.detection.pixels(),
        residuals_px=fit.residuals_px,
        R_left_from_board=fit.unknowns.R_left_from_board,
        t_left_from_board=fit.unknowns.t_left_from_board,
        focal_sigma_px=_focal_sigma(start, fit),
        baseline_sigma=_baseline_sigma(start, fit),
        others=tuple(others),
        rejected_corners=fit.rejected_corners,
        warp=fit.unknowns.warp if start.model.warped else None,
        rounds=fit.rounds,
    )


def _default_model(rig: Rig | None) -> Model:
    """One lens behind a rig, unless its glass distorts each view in its own way; two cameras without one."""
    return "two-camera" if rig is None or rig.own_lens_per_view else "one-lens"


def _start(detection: Detection, board: Board, rig: Rig | None, name: Model, options: Options) -> Start:
    views, width, height = detection.views, detection.frame_width, detection.frame_height
    plate = _plate(board, rig, name, options)
    if name == "one-lens":
        model = one_lens.model(views, width, height, plate=plate, full=bool(options.full))
    else:
        model = two_camera.model(len(views), full=options.full is not False)
    require_frames(len(detection.sightings), model, detection.rejected)
    if rig is not None:
        lenses, pose = _promise(rig, detection, glass=plate is not None)
        return Start(model, (model.own(*lenses),), (pose,) if board.unit == "mm" else None)
    points, pixels = board.points(), detection.pixels()
    if name == "one-lens":
        own = one_lens.seed(points, pixels, views, width, height)
        return Start(model, (np.append(own, np.zeros(model.matrices[0].shape[1] - own.size)),), None)
    return Start(model, two_camera.seeds(model, points, pixels, views, width, height), None)


def _plate(board: Board, rig: Rig | None, name: Model, options: Options) -> Plate | None:
    """Return the rig's glass where it is to be a part of the model; `UsageError` where it cannot be."""
    plate = None if rig is None else nominal_plate(rig)
    possible = plate is not None and name == "one-lens" and board.unit == "mm"
    if options.glass and not possible:
        raise UsageError(
            "glass can be considered for a rig with a prism or a plate, the one-lens model and a board in mm: "
            "give --rig and --square-mm, or leave --glass out"
        )
    return plate if possible and options.glass is not False else None


def _promise(rig: Rig, detection: Detection, *, glass: bool) -> tuple[tuple[Lens, Lens], Pose]:
    """Return the lenses of the rig's views on frames of this size and the pose it promises; refuse other frames."""
    if detection.views[:2] != rig.views:
        raise UsageError(f"the views are not those of rig {rig.name!r}: leave --layout out where a rig is given")
    size = detection.frame_width, detection.frame_height
    nominal = Calibration.nominal(rig) if glass else Calibration.nominal(rig).pinholes()
    pose = Pose(nominal.right.R_camera_from_left, nominal.right.t_camera_from_left)
    video, still = rig.camera.video, rig.camera.still
    left, right = nominal.left.lens, nominal.right.lens
    if size == (video.width, video.height):
        return (left, right), pose
    if size == (still.width, still.height):  # as wide a field on another grid, and taller
        left, right = (
            replace(lens.scaled(still.width / video.width), cy_px=rig.lens(still).cy_px) for lens in (left, right)
        )
        return (left, right), pose
    raise CalibrationError(
        f"the frames are {size[0]}x{size[1]}, but rig {rig.name!r} takes {video.width}x{video.height} (video) and "
        f"{still.width}x{still.height} (stills): give frames as the camera delivers them, or another rig"
    )


def _calibration(fit: Fit, board: Board, start: Start, rig: Rig | None, view: int) -> Calibration:
    """Return the calibration of the left view and another one."""
    detection, other, plate = fit.detection, fit.unknowns.others[view - 1], start.model.plate
    lenses = start.model.lenses(fit.unknowns.lens)
    views = (detection.views[0], detection.views[view])
    layout = next((name for name, known in LAYOUTS.items() if known == views), "own layout")
    return Calibration(
        rig=layout if rig is None else rig.name,
        frame_width=detection.frame_width,
        frame_height=detection.frame_height,
        left_view=views[0],
        right_view=views[1],
        left=Camera.at_origin(lenses[0], plate),
        right=Camera(lenses[view], rotation(other.R), other.t, plate),
        range=RangeWish(near_mm=1.0, far_mm=np.inf, labels=_LABELS),  # until the baseline is known
        model="one-lens" if start.model.name == "one-lens" else "two-camera",
        unit=board.unit,
        uncertainty=_uncertainty(start, fit, view),
    )


def _uncertainty(start: Start, fit: Fit, view: int) -> Uncertainty | None:
    """Return the covariance of both cameras' 24 numbers; None where the frames leave some of them undetermined."""
    model, own = start.model, fit.unknowns.lens.size
    at = own + 6 * (view - 1)
    shared = np.r_[0:own, at : at + 6]
    spread = np.zeros((len(NUMBERS), own + 6))
    spread[:9, :own], spread[9:18, :own] = model.matrices[0], model.matrices[view]
    spread[18:, own:] = np.eye(6)
    covariance = spread @ fit.covariance[np.ix_(shared, shared)] @ spread.T
    covariance = (covariance + covariance.T) / 2
    return Uncertainty(covariance) if np.isfinite(covariance).all() and (np.diag(covariance) >= 0).all() else None


def _require_rig(calibration: Calibration, rig: Rig | None) -> None:
    """Refuse a result that is far from what the rig promises: both fit the pixels, only one is right."""
    if rig is None:
        return
    nominal = Calibration.nominal(rig)
    nominal = nominal if calibration.left.plate is not None else nominal.pinholes()
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
    if not fit.unknowns.lens.size:
        return math.nan  # the lenses are not a part of this fit
    variance, focal = float(fit.covariance[index, index]), float(fit.unknowns.lens[index])
    if not 0 <= variance < (_MOST_FOCAL_SIGMA * focal) ** 2:
        sigma = math.sqrt(variance) if variance >= 0 else math.nan
        raise CalibrationError(
            f"the frames leave the focal length at {focal:.0f} +- {sigma:.0f} px: tilt the board 20 to 40 degrees in "
            "different directions, near and far"
        )
    return math.sqrt(variance)


def _baseline_sigma(start: Start, fit: Fit) -> float:
    shift = fit.unknowns.others[0].t
    along, at = shift / np.linalg.norm(shift), start.model.matrices[0].shape[1] + 3
    return math.sqrt(max(float(along @ fit.covariance[at : at + 3, at : at + 3] @ along), 0.0))
