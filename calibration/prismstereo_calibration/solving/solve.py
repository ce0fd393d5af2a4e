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
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration, Model
from prismstereo_calibration.solving import two_camera
from prismstereo_calibration.solving.bundle import adjust
from prismstereo_calibration.solving.fit import Fit, RejectedCorner, Start, fit_frames
from prismstereo_calibration.solving.outcome import calibration_of, range_of, require_rig
from prismstereo_calibration.solving.starting import Options, default_model, start_of
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import RangeWish, Rig

__all__ = ["Options", "Solution", "solve"]

Array = NDArray[np.float64]

_MOST_FOCAL_SIGMA = 0.1  # of the focal length
_FEWEST_BASELINE_SIGMAS = 3.0
_FEWEST_TO_BEND = 5  # frames: with fewer, a bend and a tilt look alike
_CLEAR_BEND = 6.0  # sigmas


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
    name = model or default_model(rig)
    start, fit, found = _solved(detection, board, rig, name, options)
    require_rig(found[0], rig)
    settled = [
        replace(one, range=wish or range_of(one, rig), lens_position=lens_position, temperature_c=temperature_c)
        for one in found
    ]
    return _account(settled, start, fit)


def _fitted(detection: Detection, board: Board, rig: Rig | None, name: Model, options: Options) -> tuple[Start, Fit]:
    start = start_of(detection, board, rig, name, options)
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
    return tuple(calibration_of(fit, board, start, rig, view) for view in range(1, len(fit.detection.views)))


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
    length, at = float(np.linalg.norm(shift)), start.model.matrices[0].shape[1] + 3
    along = shift / length
    sigma = math.sqrt(max(float(along @ fit.covariance[at : at + 3, at : at + 3] @ along), 0.0))
    if length < _FEWEST_BASELINE_SIGMAS * sigma:
        raise CalibrationError(
            f"the two views stand in one place, {length:.2g} +- {sigma:.2g} apart: give pictures of two viewpoints, the left "
            "and the right one"
        )
    return sigma
