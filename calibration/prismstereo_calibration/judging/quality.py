"""How good a calibration is, in figures of the thing it is for: the board's corners as the two views place them.

Gap and plane fit are those of the paper's table 1. All lengths are in `unit`: millimetres, or squares of the board. Corners
that one of the first two views does not show are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.judging import criteria
from prismstereo_calibration.judging.assembly import Assembly, assembly
from prismstereo_calibration.judging.criteria import Criterion, Verdict
from prismstereo_calibration.judging.next_view import NextView, next_views
from prismstereo_calibration.judging.plane import FEWEST_POINTS, PlaneFit
from prismstereo_calibration.judging.triangulation import triangulate
from prismstereo_calibration.judging.uncertainty_map import UncertaintyMap, uncertainty_maps, yardstick
from prismstereo_calibration.judging.view_field import covered_share
from prismstereo_calibration.model import Calibration, Unit
from prismstereo_calibration.rectification import rectification
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_calibration.solving.solve import Solution

__all__ = [
    "Criterion", "Floor", "PlaneFit", "Quality", "RowError", "ScaleError", "Spread", "Verdict", "judge", "triangulate",
]  # fmt: skip

Array = NDArray[np.float64]

_ROW_PERCENTILE = 95.0
_HALF_NORMAL = math.sqrt(2 / math.pi)  # mean of |x| over its standard deviation


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and variance of absolute values, in the unit and in its square."""

    mean: float
    variance: float


@dataclass(frozen=True, slots=True)
class Floor:
    """What the corners' noise alone makes of gap and plane fit, means of absolute values in the unit (closed form)."""

    triangulation_gap: float
    plane_fit: float

    @classmethod
    def of(cls, calibration: Calibration, depth: float, noise_px: float) -> Floor:
        """Return the floor at a mean depth for noise per axis (reference: optics, section 4, noise floor)."""
        gap = _HALF_NORMAL * math.sqrt(2) * noise_px * depth / calibration.focal_px
        return cls(gap, gap * depth / calibration.baseline)


@dataclass(frozen=True, slots=True)
class RowError:
    """How far the two pictures of a corner are from one row after rectification, absolute, in pixels.

    `all_px` is every corner's, signed: row in the left picture less row in the right one.
    """

    mean_px: float
    p95_px: float
    all_px: Array = field(default_factory=lambda: np.zeros(0), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ScaleError:
    """Measured over true size of the boards (the best similarity), less one: signed mean, and rms over the frames."""

    mean: float
    rms: float


@dataclass(frozen=True, slots=True)
class Quality:
    """The figures, and the criteria with their limits; `verdict` is the worst band among them.

    `yardstick` is the distance at which criteria are said as lengths. `maps` are empty where the calibration has no
    uncertainty; `coverage` (of each view), `floor` and `next_views` are known where the solution was given.
    """

    unit: Unit
    views: int
    triangulation_gap: Spread
    plane_fit: PlaneFit
    row_error: RowError
    scale_error: ScaleError
    criteria: tuple[Criterion, ...]
    assembly: Assembly
    yardstick: float
    maps: tuple[UncertaintyMap, ...] = ()
    floor: Floor | None = None
    coverage: tuple[float, ...] = ()
    next_views: tuple[NextView, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """Return good, usable or redo."""
        return criteria.worst(self.criteria)


def judge(
    calibration: Calibration,
    detection: Detection,
    board: Board,
    *,
    rms_px: float | None = None,
    solution: Solution | None = None,
) -> Quality:
    """Judge a calibration by corner pairs: those it was solved from (give its `solution` then) or fresh ones.

    `rms_px`, the reprojection error, follows from the solution, and corners that it rejected do not count.
    `CalibrationError` where there is no pair, too few corners in both views, or frames of another size; `UsageError` where
    the board's unit is another than the calibration's.
    """
    _require_same(calibration, detection, board)
    rms_px = solution.rms_px if solution is not None and rms_px is None else rms_px
    pixels = _counted(detection, solution)
    corners, gaps = triangulate(calibration, pixels[:, 0], pixels[:, 1])
    seen = np.isfinite(gaps)
    boards = _boards(corners, seen, board)
    gap = gaps[seen]
    row_error, scale_error = _row_error(calibration, pixels, seen), _scale_error(boards)
    noise_px = None if rms_px is None else rms_px / math.sqrt(2)
    coverage, maps = _coverage(calibration, solution), uncertainty_maps(calibration)
    return Quality(
        unit=calibration.unit,
        views=int(seen.any(axis=1).sum()),
        triangulation_gap=Spread(float(gap.mean()), float(gap.var())),
        plane_fit=PlaneFit.of([found for found, _ in boards]),
        row_error=row_error,
        scale_error=scale_error,
        criteria=_criteria(calibration, row_error, scale_error, rms_px, maps, coverage, solution),
        assembly=assembly(calibration),
        yardstick=yardstick(calibration),
        maps=maps,
        floor=None if noise_px is None else Floor.of(calibration, float(corners[seen][:, 2].mean()), noise_px),
        coverage=coverage,
        next_views=() if solution is None or not noise_px else next_views(calibration, board, noise_px, maps),
    )


def _counted(detection: Detection, solution: Solution | None) -> Array:
    """Return the pixels (V, K, N, 2) to judge by: those of all sightings, NaN where the solution rejected a corner."""
    pixels = detection.pixels()
    if solution is not None:
        rejected = {name: np.isnan(corners) for name, corners in zip(solution.used, solution.corners_px, strict=True)}
        for index, sighting in enumerate(detection.sightings):
            if sighting.name in rejected:
                pixels[index][rejected[sighting.name]] = np.nan
    return pixels


def _boards(corners: Array, seen: NDArray[np.bool_], board: Board) -> list[tuple[Array, Array]]:
    """Return the corners (N, 3) of each frame, found and true, where there are enough; `CalibrationError` for none."""
    points = board.points()
    boards = [(one[ok], points[ok]) for one, ok in zip(corners, seen, strict=True) if ok.sum() >= FEWEST_POINTS]
    if not boards:
        raise CalibrationError(
            f"no frame shows {FEWEST_POINTS} corners of the board in both views: hold it where both see it"
        )
    return boards


def _coverage(calibration: Calibration, solution: Solution | None) -> tuple[float, ...]:
    if solution is None:
        return ()
    corners = np.where(np.isfinite(solution.residuals_px), solution.corners_px, np.nan)
    return (
        covered_share(calibration, "left", corners[:, 0]),
        covered_share(calibration, "right", corners[:, 1]),
    )


def _criteria(
    calibration: Calibration,
    row_error: RowError,
    scale_error: ScaleError,
    rms_px: float | None,
    maps: tuple[UncertaintyMap, ...],
    coverage: tuple[float, ...],
    solution: Solution | None,
) -> tuple[Criterion, ...]:
    """List what the verdict rests on: what is known of the fit, of the corners, of the uncertainty, of the frames."""
    depth, focal_px = yardstick(calibration), calibration.focal_px
    found = [] if rms_px is None else [criteria.rms_criterion(rms_px, depth, focal_px * calibration.baseline)]
    found.append(criteria.row_criterion(row_error.mean_px, depth, focal_px))
    found.append(criteria.scale_criterion(scale_error.mean, depth))
    found += [criteria.depth_criterion(one.typical, one.depth) for one in maps if one.depth == depth]
    sides = ("left", "right")[: len(coverage)]
    found += [
        criteria.coverage_criterion(side, share)
        for side, share in zip(sides, coverage, strict=True)
        if math.isfinite(share)  # views with no field in common where a board can be held are judged by the rest
    ]
    if solution is not None:
        found.append(criteria.views_criterion(len(solution.used)))
    return tuple(found)


def _require_same(calibration: Calibration, detection: Detection, board: Board) -> None:
    if not detection.sightings:
        raise CalibrationError("there is no frame with the board in both views to judge by: give some")
    size, own = (detection.frame_width, detection.frame_height), (calibration.frame_width, calibration.frame_height)
    if size != own or detection.views[:2] != calibration.views:
        raise CalibrationError(
            f"the frames are {size[0]}x{size[1]}, the calibration of {calibration.rig!r} is for {own[0]}x{own[1]} and its "
            "own views: give frames of that mode, split as that rig says"
        )
    if board.unit != calibration.unit:
        raise UsageError(
            f"the board is given in {board.unit}, but the calibration is in {calibration.unit}: "
            "give --square-mm to both or to none"
        )


def _row_error(calibration: Calibration, pixels: Array, seen: NDArray[np.bool_]) -> RowError:
    """Rectify both pictures of every corner, as depth is made of them, and compare their rows."""
    pair = rectification(calibration)
    left, right = pair.rectify(pixels[:, 0], pair.left), pair.rectify(pixels[:, 1], pair.right)
    off = (left - right)[..., 1][seen]
    return RowError(float(np.abs(off).mean()), float(np.percentile(np.abs(off), _ROW_PERCENTILE)), off)


def _scale_error(boards: list[tuple[Array, Array]]) -> ScaleError:
    """Fit the board to what was measured of it by a similarity, frame by frame, after Umeyama."""
    errors = np.array([_similarity_scale(found, true) - 1 for found, true in boards])
    return ScaleError(float(errors.mean()), math.sqrt(float(np.mean(errors**2))))


def _similarity_scale(found: Array, true: Array) -> float:
    """Return the scale that takes the true points (N, 3) onto the found ones with the least squares left over."""
    found, true = found - found.mean(axis=0), true - true.mean(axis=0)
    U, sizes, V = np.linalg.svd(found.T @ true)
    sizes[2] *= np.sign(np.linalg.det(U @ V))
    return float(sizes.sum() / np.sum(true**2))
