"""Whether a calibration still holds, from a few frames of anything, or better of a board.

Each finding has two limits: up to the first all is fine, up to the second `refine` mends it, beyond it the unit must see a
board again. Without a board nothing can be said of lengths but what the rows imply: a mirror that turned shows in them, a focus
ring does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.upkeep.depth_probe import DepthProbe
from prismstereo_calibration.upkeep.doubts import doubts_px
from prismstereo_calibration.upkeep.focus import BoardFindings
from prismstereo_calibration.upkeep.mount import Mount
from prismstereo_calibration.upkeep.pose_fit import PoseFit, fit_pose
from prismstereo_calibration.upkeep.refine import FARTHEST, require_matches
from prismstereo_calibration.upkeep.sightlines import SceneMatches, Sightlines

__all__ = ["Advice", "Check", "Finding", "State", "check"]

Array = NDArray[np.float64]
Advice = Literal["fine", "refine", "recalibrate"]

_ADVICE: tuple[Advice, ...] = ("fine", "refine", "recalibrate")
_SURE = 2.0  # standard errors that are taken off before a figure counts
_OUTLIER = 4.0  # sigmas
_EACH_WAY = 3  # cells each way in which what is left of the rows is averaged
_FEWEST_IN_CELL = 8
_CLEAR = 10.0  # a difference of Akaike's criterion that leaves no doubt


@dataclass(frozen=True, slots=True)
class Finding:
    """One figure: up to `fine` it is fine, up to `refine` refining mends it, beyond that only a new calibration does."""

    name: str
    value: float
    fine: float
    refine: float
    unit: str

    @property
    def advice(self) -> Advice:
        """What this figure asks for; one that is no number asks for a new calibration."""
        if self.value <= self.fine:
            return "fine"
        return "refine" if self.value <= self.refine else "recalibrate"


@dataclass(frozen=True, slots=True)
class State:
    """What else is known of how the frames were taken, None where it is not."""

    lens_position: int | None = None
    temperature_c: float | None = None


@dataclass(frozen=True, slots=True)
class Check:
    """The findings, what they ask for together, and the likely cause in words, "" where all is fine or nobody can tell.

    `depth_sigma`: one standard deviation, as a share of the depth, of what the rows alone say of depth `at_depth`. Errors below
    twice that stay unseen without a board.
    """

    scenes: int
    matches: int
    findings: tuple[Finding, ...]
    cause: str
    at_depth: float
    depth_sigma: float
    board: BoardFindings | None

    @property
    def advice(self) -> Advice:
        """Return fine, refine or recalibrate: the worst of the findings."""
        return max((finding.advice for finding in self.findings), key=_ADVICE.index)


def check(
    calibration: Calibration,
    scenes: Sequence[SceneMatches],
    mount: Mount,
    *,
    board: BoardFindings | None = None,
    state: State | None = None,
) -> Check:
    """Judge a calibration by what both views show of a few scenes and, if there are any, by boards.

    `CalibrationError` where no scene shows enough.
    """
    state = state or State()
    seen = require_matches(scenes, 1)
    lines = Sightlines.of(calibration, seen)
    fit = fit_pose(lines, doubts_px(calibration, seen, mount.plate), calibration.right, mount)
    probe = DepthProbe.of(calibration)
    sigma = probe.sigma(calibration, mount, fit.amounts, fit.covariance)
    findings = [*_rows(calibration, seen, lines, fit), _depth(calibration, probe, fit, sigma)]
    findings += [] if board is None else _of_board(board)
    findings += _of_state(calibration, state)
    advice = max((finding.advice for finding in findings), key=_ADVICE.index)
    return Check(
        scenes=len(seen),
        matches=len(lines.scene),
        findings=tuple(findings),
        cause="" if advice == "fine" else _cause(calibration, fit, board, findings),
        at_depth=probe.depth,
        depth_sigma=sigma,
        board=board,
    )


def _rows(calibration: Calibration, seen: Sequence[SceneMatches], lines: Sightlines, fit: PoseFit) -> list[Finding]:
    """Return what the rows say, before and after the pose is fitted."""
    right = calibration.right
    rows = lines.rows_px(right.R_camera_from_left, right.t_camera_from_left)
    mended = lines.rows_px(fit.R, fit.t)
    good = np.abs(mended) < _OUTLIER * fit.sigma_px
    left_px = np.concatenate([scene.left_px for scene in seen])
    centred = left_px[good] - left_px[good].mean(axis=0)
    design = np.column_stack([np.ones(len(centred)), centred])
    slope = np.linalg.lstsq(design, rows[good], rcond=None)[0][1:]
    extent = np.percentile(centred, 95, axis=0) - np.percentile(centred, 5, axis=0)
    return [
        Finding("vertical disparity, median", abs(float(np.median(rows[good]))), 0.3, 12.0, "px"),
        Finding("vertical disparity, slope over the view", float(np.abs(slope * extent).sum()), 0.5, 12.0, "px"),
        Finding("vertical disparity, 95 % below", float(np.percentile(np.abs(rows[good]), 95)), 1.2, 12.0, "px"),
        Finding("vertical disparity no pose explains", _pattern_px(left_px[good], mended[good]), 0.3, 0.3, "px"),
    ]


def _pattern_px(left_px: Array, rows: Array) -> float:
    """Return the root mean square over the cells of the view of what their points have in common, noise taken off."""
    low, high = left_px.min(axis=0), left_px.max(axis=0)
    cell = np.minimum((left_px - low) / np.maximum(high - low, 1e-9) * _EACH_WAY, _EACH_WAY - 1).astype(int)
    name = cell[:, 0] * _EACH_WAY + cell[:, 1]
    squares = []
    for index in np.unique(name):
        here = rows[name == index]
        if len(here) >= _FEWEST_IN_CELL:
            squares.append(float(here.mean()) ** 2 - float(here.var(ddof=1)) / len(here))
    return math.sqrt(max(0.0, float(np.mean(squares)))) if squares else 0.0


def _depth(calibration: Calibration, probe: DepthProbe, fit: PoseFit, sigma: float) -> Finding:
    """Return the depth error that the rows imply, as far as it is sure."""
    change = max(0.0, abs(probe.change(fit.R, fit.t)) - _SURE * sigma) * probe.depth
    unit = calibration.unit
    return Finding(
        f"depth error at {probe.depth:.4g} {unit}, at least", change, 0.005 * probe.depth, 0.1 * probe.depth, unit
    )


def _of_board(board: BoardFindings) -> list[Finding]:
    scale = max(0.0, abs(board.scale_error) - _SURE * board.scale_sigma)
    focal = max(0.0, abs(board.focal_change) - _SURE * board.focal_sigma)
    return [
        Finding("length error on the board, at least", 100 * scale, 0.3, 5.0, "%"),
        Finding("focal length changed, at least", 100 * focal if board.focus_moved else 0.0, 0.2, 0.2, "%"),
        Finding("board corners, best fit, rms", board.rms_px, 1.0, 12.0, "px"),
    ]


def _of_state(calibration: Calibration, state: State) -> list[Finding]:
    findings = []
    if state.lens_position is not None and calibration.lens_position is not None:
        off = float(abs(state.lens_position - calibration.lens_position))
        findings.append(Finding("lens position off", off, 0.0, 0.0, "steps"))
    if state.temperature_c is not None and calibration.temperature_c is not None:
        off = abs(state.temperature_c - calibration.temperature_c)
        findings.append(Finding("temperature off", off, 10.0, 40.0, "K"))
    return findings


def _cause(calibration: Calibration, fit: PoseFit, board: BoardFindings | None, findings: Sequence[Finding]) -> str:
    """Name what most likely happened."""
    asked = {finding.name for finding in findings if finding.advice != "fine"}
    if board is not None and "focal length changed, at least" in asked:
        return (
            f"the focus ring was moved: the focal length changed by {100 * board.focal_change:+.2f} % "
            f"(+- {100 * board.focal_sigma:.2f}); set it back, or calibrate again"
            + ("" if board.focus_evidence > _CLEAR else " (both mirrors turned alike would look nearly the same)")
        )
    if "lens position off" in asked:
        return "the lens stands at another position than when it was calibrated: set it back, or calibrate again"
    if np.abs(fit.amounts).max() > FARTHEST:
        return "nothing that a mount does explains the rows: another lens, another unit, or a knock"
    turned = np.degrees(_turn(calibration.right.R_camera_from_left, fit.R))
    said = []
    if any(name.startswith("vertical") for name in asked):
        said.append(f"one view looks {abs(turned[0]):.3f} deg higher or lower than it did: a mirror has tipped")
    if any(name.startswith("depth") for name in asked):
        said.append(f"the views converge by {abs(turned[1]):.3f} deg more or less: a mirror has turned by half of that")
    return "; ".join(said)


def _turn(before: Array, after: Array) -> Array:
    """Return the axis (3,) times the angle, in radians, of the small turn between two rotations."""
    change = after @ before.T
    return np.array([change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]]) / 2
