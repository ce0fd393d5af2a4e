"""How good a calibration is, in figures of the thing it is for: the board's corners as the two views place them.

Gap and plane fit are those of the paper's table 1. All lengths are in `unit`: millimetres, or squares of the board.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.board import Board
from prismstereo_calibration.detection import Detection
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration, Unit
from prismstereo_hw.errors import UsageError

__all__ = ["Criterion", "PlaneFit", "Quality", "RowError", "ScaleError", "Spread", "Verdict", "judge", "triangulate"]

Array = NDArray[np.float64]
Verdict = Literal["good", "usable", "redo"]

_BANDS: tuple[Verdict, ...] = ("good", "usable", "redo")
_ROW_PERCENTILE = 95.0
_SMALLEST_SINE = 1e-9  # of the angle between two rays that meet


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and variance of absolute values, in the unit and in its square."""

    mean: float
    variance: float


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """Distances of triangulated corners from the plane of least squares through their board: of absolute values, and rms."""

    mean: float
    variance: float
    rms: float


@dataclass(frozen=True, slots=True)
class RowError:
    """How far the two pictures of a corner are from one row after rectification, absolute, in pixels."""

    mean_px: float
    p95_px: float


@dataclass(frozen=True, slots=True)
class ScaleError:
    """Measured over true length of the boards' sides, less one: signed mean, and rms."""

    mean: float
    rms: float


@dataclass(frozen=True, slots=True)
class Criterion:
    """One figure that the verdict rests on: below `good` it is good, up to `usable` it can be used."""

    name: str
    value: float
    good: float
    usable: float
    unit: str

    @property
    def band(self) -> Verdict:
        """The band this figure falls in; a figure that is not a number falls in the last."""
        if self.value <= self.good:
            return "good"
        return "usable" if self.value <= self.usable else "redo"


@dataclass(frozen=True, slots=True)
class Quality:
    """The figures, and the criteria with their limits; `verdict` is the worst band among them."""

    unit: Unit
    views: int
    triangulation_gap: Spread
    plane_fit: PlaneFit
    row_error: RowError
    scale_error: ScaleError
    criteria: tuple[Criterion, ...]

    @property
    def verdict(self) -> Verdict:
        """Return good, usable or redo."""
        return max((criterion.band for criterion in self.criteria), key=_BANDS.index)


def triangulate(calibration: Calibration, left_px: Array, right_px: Array) -> tuple[Array, Array]:
    """Intersect the rays of two upright pixels (..., 2) each.

    Returns the middle of the shortest line between them (..., 3), in the left camera's frame and the calibration's unit,
    and the length of that line (...).
    """
    from_a, a = calibration.left.rays(left_px)
    from_b, b = calibration.right.rays(right_px)
    apart = from_b - from_a
    cosine = np.sum(a * b, axis=-1)
    sine2 = np.maximum(1 - cosine**2, _SMALLEST_SINE**2)
    along_a, along_b = np.sum(a * apart, axis=-1), np.sum(b * apart, axis=-1)
    reach_a = (along_a - cosine * along_b) / sine2
    reach_b = (cosine * along_a - along_b) / sine2
    on_a, on_b = from_a + reach_a[..., None] * a, from_b + reach_b[..., None] * b
    return (on_a + on_b) / 2, np.linalg.norm(on_b - on_a, axis=-1)


def judge(calibration: Calibration, detection: Detection, board: Board, *, rms_px: float | None = None) -> Quality:
    """Judge a calibration by corner pairs: those it was solved from (give its `rms_px` then) or fresh ones.

    `CalibrationError` where there is no pair or the frames have another size, `UsageError` where the board's unit is
    another than the calibration's.
    """
    _require_same(calibration, detection, board)
    pixels = detection.pixels()
    corners, gap = triangulate(calibration, pixels[:, 0], pixels[:, 1])
    off_plane = np.abs(_off_plane(corners))
    rows = _row_error_px(calibration, pixels)
    scale = _scale_error(corners, board)
    row_error = RowError(float(rows.mean()), float(np.percentile(rows, _ROW_PERCENTILE)))
    scale_error = ScaleError(float(scale.mean()), float(np.sqrt(np.mean(scale**2))))
    return Quality(
        unit=calibration.unit,
        views=len(pixels),
        triangulation_gap=Spread(float(gap.mean()), float(gap.var())),
        plane_fit=PlaneFit(float(off_plane.mean()), float(off_plane.var()), float(np.sqrt(np.mean(off_plane**2)))),
        row_error=row_error,
        scale_error=scale_error,
        criteria=_criteria(row_error, scale_error, rms_px),
    )


def _criteria(row_error: RowError, scale_error: ScaleError, rms_px: float | None) -> tuple[Criterion, ...]:
    """List what the verdict rests on. A board detector's own noise, 0.2 px per axis, reads 0.28, 0.23 and 0.001."""
    fit = () if rms_px is None else (Criterion("reprojection rms", rms_px, 0.5, 1.0, "px"),)
    return (
        *fit,
        Criterion("mean row error", row_error.mean_px, 0.4, 0.8, "px"),
        Criterion("scale error", abs(scale_error.mean), 0.003, 0.01, "of the length"),
    )


def _require_same(calibration: Calibration, detection: Detection, board: Board) -> None:
    if not detection.sightings:
        raise CalibrationError("there is no frame with the board in both views to judge by: give some")
    size, own = (detection.frame_width, detection.frame_height), (calibration.frame_width, calibration.frame_height)
    if size != own or detection.views != calibration.views:
        raise CalibrationError(
            f"the frames are {size[0]}x{size[1]}, the calibration of {calibration.rig!r} is for {own[0]}x{own[1]} and its "
            "own views: give frames of that mode, split as that rig says"
        )
    if board.unit != calibration.unit:
        raise UsageError(
            f"the board is given in {board.unit}, but the calibration is in {calibration.unit}: "
            "give --square-mm to both or to none"
        )


def _off_plane(corners: Array) -> Array:
    """Return signed distances (V, N) of corners (V, N, 3) from their own planes of least squares."""
    centred = corners - corners.mean(axis=1, keepdims=True)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    return np.asarray((centred @ axes[:, 2, :, None])[..., 0])


def _row_error_px(calibration: Calibration, pixels: Array) -> Array:
    """Return |row left - row right| (V, N): rays turned so that the baseline is the x axis, at the left focal length."""
    x = calibration.right.centre / calibration.baseline
    forward = calibration.left.R_camera_from_left[2] + calibration.right.R_camera_from_left[2]
    y = np.cross(forward, x)
    y /= np.linalg.norm(y)
    z = np.cross(x, y)
    rows = [
        calibration.left.lens.fx_px * (rays @ y) / (rays @ z)
        for rays in (calibration.left.rays(pixels[:, 0]), calibration.right.rays(pixels[:, 1]))
    ]
    return np.asarray(np.abs(rows[0] - rows[1]))


def _scale_error(corners: Array, board: Board) -> Array:
    """Return measured over true length, less one, of the four sides of each board's outermost corners (V, 4)."""
    grid = corners.reshape(-1, board.rows, board.columns, 3)
    ring = np.stack([grid[:, 0, 0], grid[:, 0, -1], grid[:, -1, -1], grid[:, -1, 0]], axis=1)
    measured = np.linalg.norm(ring - np.roll(ring, -1, axis=1), axis=-1)
    true = np.array([board.columns - 1, board.rows - 1] * 2) * board.square
    return np.asarray(measured / true - 1)
