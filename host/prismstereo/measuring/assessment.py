"""Judging one source of frames: a flat target, or a scene with its truth."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.measuring.account import FlatTarget, TrueScene
from prismstereo.measuring.flat_target import ROI_SHARE, flat_figures
from prismstereo.measuring.frames import MeasuringFrame
from prismstereo.measuring.gap import Gap, board_gap, scene_gap
from prismstereo.measuring.levels import levels
from prismstereo.measuring.patch import Patch
from prismstereo.measuring.plane import fit_plane
from prismstereo.measuring.relief import Relief
from prismstereo.measuring.truth_bins import truth_bins
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.truth import true_disparity
from prismstereo_hw.errors import UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import RangeWish

__all__ = ["assess_flat", "assess_scene"]

Array = NDArray[np.float64]
_GAP_FRAMES = 5  # of a source: features of a scene at rest are the same in all of them
_JUST_WITHIN = 1.0005  # the near end is a border: rounding may not push it out


def assess_flat(
    source: str,
    frames: Iterable[MeasuringFrame],
    true_mm: float | None = None,
    roi: Patch | None = None,
    board: Board | None = None,
) -> FlatTarget:
    """Judge frames of a flat target; where their truth is known and no distance is given, the true plane tells it."""
    reliefs, maps = [], []
    raws: list[RawFrame] = []
    calibration: Calibration | None = None
    for frame in frames:
        relief = Relief.of_frame(frame.depth)
        patch = roi or Patch.centred(relief.inverse_px.shape[1], relief.inverse_px.shape[0], ROI_SHARE)
        relief.require_inside(patch)
        if true_mm is None and frame.truth is not None:
            true_mm = fit_plane(_truth(frame), patch).distance.value_mm
        reliefs.append(relief)
        maps.append(frame.depth.disparity.disparity_px[patch.y : patch.bottom, patch.x : patch.right])
        calibration = frame.depth.geometry.calibration
        raws += [] if frame.raw is None or len(raws) == _GAP_FRAMES else [frame.raw]
    figures = flat_figures(reliefs, true_mm, roi)
    worth = figures.distance_mm**2 / reliefs[0].scale_px
    gap = None if calibration is None else _gap(calibration, raws, board)
    return FlatTarget(source, figures, worth * figures.subpixel_rms_px, gap, levels(maps))


def assess_scene(source: str, frames: Iterable[MeasuringFrame], board: Board | None = None) -> TrueScene:
    """Judge frames of a scene against its truth, by distance; `UsageError` for a source without truth."""
    found, true, maps = [], [], []
    raws: list[RawFrame] = []
    last: Relief | None = None
    for frame in frames:
        if frame.truth is None:
            raise UsageError(f"{source} holds no truth: judge it as a flat target, or simulate a session")
        last = Relief.of_frame(frame.depth)
        truth = _truth(frame)
        known = np.isfinite(truth.inverse_px)
        true.append((truth.scale_px / truth.inverse_px)[known])
        found.append((last.scale_px / last.inverse_px)[known])
        maps.append(frame.depth.disparity.disparity_px)
        raws += [] if frame.raw is None or len(raws) == _GAP_FRAMES else [frame.raw]
    if last is None:
        raise UsageError(f"{source} holds no frame: figures need one or more")
    depth, real = np.concatenate(found), np.concatenate(true)
    return TrueScene(
        source=source,
        frames=len(maps),
        fill_percent=100 * float(np.isfinite(depth).mean()) if len(depth) else 0.0,
        by_distance=truth_bins(depth, real, last.scale_px),
        triangulation_gap_mm=_gap(last.geometry.calibration, raws, board),
        levels=levels(maps),
    )


def _truth(frame: MeasuringFrame) -> Relief:
    """Return the true relief, where a match exists: of true depths, so that a wrong calibration shows as one."""
    geometry, window = frame.depth.geometry, frame.depth.disparity.window
    assert frame.truth is not None
    if geometry.decimated > 1:
        raise UsageError("the frames are smaller than their truth: judge frames of the calibrated size")
    own = rectification(geometry.calibration)
    if window != own.window:
        wish = RangeWish(near_mm=window.nearest * _JUST_WITHIN, far_mm=window.farthest, labels=window.labels)
        own = rectification(geometry.calibration, wish, window.labels)
    matched = np.isfinite(true_disparity(frame.truth, own))
    source = own.sources(own.left)
    depth = cv2.remap(frame.truth.depth_mm, source[..., 0], source[..., 1], cv2.INTER_LINEAR)[matched].astype(float)
    x, y, _, _ = own.left.view.rectangle(own.frame_width, own.frame_height)
    origin, direction = geometry.calibration.left.rays(source[matched].astype(float) + np.array([x, y]))
    point = origin + direction * ((depth - origin[:, 2]) / direction[:, 2])[:, None]
    inverse = np.full(matched.shape, np.nan)
    inverse[matched] = window.scale_px / ((point - own.left.pinhole) @ own.left.R_rectified_from_left[2])
    return Relief(inverse, geometry)


def _gap(calibration: Calibration, raws: list[RawFrame], board: Board | None) -> Gap | None:
    if not raws:
        return None
    return scene_gap(calibration, raws) if board is None else board_gap(calibration, raws, board)
