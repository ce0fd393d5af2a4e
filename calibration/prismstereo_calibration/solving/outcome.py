"""What a fit comes to: calibrations, held against the rig that took the frames, and how well their numbers are known."""

from __future__ import annotations

import numpy as np

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.solving.fit import Fit, Start
from prismstereo_calibration.solving.poses import rotation
from prismstereo_calibration.uncertainty import NUMBERS, Uncertainty
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import LAYOUTS

__all__ = ["calibration_of", "range_of", "require_rig"]

_LABELS = 128
_NEAREST_SLACK = 1.001
_MOST_OFF_RIG = 0.25  # a mount is built to a few per cent; beyond this it is another rig or another square


def calibration_of(fit: Fit, board: Board, start: Start, rig: Rig | None, view: int) -> Calibration:
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


def require_rig(calibration: Calibration, rig: Rig | None) -> None:
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


def range_of(calibration: Calibration, rig: Rig | None) -> RangeWish:
    """Return the rig's range where it is in this unit, else what the labels reach, up to infinity."""
    if rig is not None and calibration.unit == "mm":
        return rig.range
    scale = calibration.focal_px * calibration.baseline
    near = scale / (_LABELS - 2 - 1) * _NEAREST_SLACK
    window = DisparityWindow.between(scale, near, np.inf, _LABELS)
    return RangeWish(near_mm=near, far_mm=np.inf, labels=window.labels)
