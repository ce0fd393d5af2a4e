"""Fit a lens model to the frames that agree, and name those that do not.

Place the board in every frame -> a robust fit that one bad frame cannot pull along -> frames that do not fit are dropped
by name -> plain least squares on the rest -> again, until every frame fits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.board import Board
from prismstereo_calibration.bundle import LensModel, Unknowns, adjust, residuals
from prismstereo_calibration.detection import Detection, Rejection
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.first_guess import spread
from prismstereo_calibration.poses import Pose, agreed, board_poses
from prismstereo_hw.lens import Lens

__all__ = ["Fit", "Start", "fit_frames", "outlier_limit", "require_frames"]

Array = NDArray[np.float64]

_OUTLIER_TIMES, _OUTLIER_PX = 3.0, 0.5
_MOST_ROUNDS = 6
_TURNED_DEG = 30.0  # how far a frame's relative pose may be off by noise and the two-fold pose of a flat board
_TOLERANCE_TIMES, _LEAST_TOLERANCE_PX = 3.0, 0.5
_ANNEALINGS, _ANNEALING_ROUNDS = 5, 30
_FRAMES_TO_CHOOSE = 12
_TILT = "tilt the board 20 to 40 degrees in different directions, near and far"


@dataclass(frozen=True, slots=True)
class Start:
    """A lens model, its numbers to start from, and the right-from-left pose where a rig tells it in the board's unit.

    Of several starts the one that leads to the best fit of a few frames is taken.
    """

    model: LensModel
    lenses: tuple[Array, ...]
    right: Pose | None


@dataclass(frozen=True, slots=True)
class Fit:
    """The unknowns of least squares over the frames of `detection`, in its order, and who was rejected on the way.

    `residuals_px` are projected minus measured (V, 2, N, 2); `covariance` is that of lens numbers, turn (rad) and shift.
    """

    unknowns: Unknowns
    residuals_px: Array
    covariance: Array
    detection: Detection
    rejected: tuple[Rejection, ...]


@dataclass(frozen=True, slots=True)
class _Trial:
    """The frames still in, and where everything stands by now."""

    detection: Detection
    unknowns: Unknowns
    rejected: tuple[Rejection, ...]

    def without(self, why: list[str | None]) -> _Trial:
        """Leave out the frames for which there is a reason."""
        pairs, state = self.detection.sightings, self.unknowns
        good = np.array([reason is None for reason in why])
        gone = tuple(
            Rejection(pair.name, reason) for pair, reason in zip(pairs, why, strict=True) if reason is not None
        )
        return _Trial(
            replace(self.detection, sightings=tuple(pair for pair, ok in zip(pairs, good, strict=True) if ok)),
            replace(
                state,
                R_left_from_board=state.R_left_from_board[good],
                t_left_from_board=state.t_left_from_board[good],
            ),
            self.rejected + gone,
        )


def require_frames(count: int, model: LensModel, rejected: tuple[Rejection, ...]) -> None:
    """Refuse to solve from fewer frames than the model needs; `CalibrationError` says what became of the others."""
    if count < model.fewest_frames:
        because = "; ".join(f"{entry.name}: {entry.reason}" for entry in rejected[:3])
        raise CalibrationError(
            f"frames that show the board as they should: {count}, but the {model.name} model needs {model.fewest_frames}; "
            f"take 10 to 20, the board near and far and tilted{f' (rejected: {because})' if because else ''}"
        )


def outlier_limit(frame_rms_px: Array) -> float:
    """Return the rms in pixels beyond which a frame does not fit the others."""
    return max(_OUTLIER_TIMES * float(np.median(frame_rms_px)), _OUTLIER_PX)


def fit_frames(detection: Detection, board: Board, start: Start) -> Fit:
    """Fit a model from its start to as many frames as agree; `CalibrationError` where they do not determine it."""
    model, points = start.model, board.points()
    lens = _best_lens(detection, points, start)
    trial = _placed(detection, points, model, lens, start.right)
    require_frames(len(trial.detection.sightings), model, trial.rejected)
    trial = replace(trial, unknowns=_annealed(model, points, trial))
    for _ in range(_MOST_ROUNDS):
        trial = trial.without(_misfits(residuals(model, points, trial.detection.pixels(), trial.unknowns)))
        require_frames(len(trial.detection.sightings), model, trial.rejected)
        pixels = trial.detection.pixels()
        try:
            minimum = adjust(model, points, pixels, trial.unknowns)
        except np.linalg.LinAlgError as error:
            raise CalibrationError(f"the frames do not determine the cameras: {_TILT}") from error
        trial = replace(trial, unknowns=minimum.state)
        off = residuals(model, points, pixels, minimum.state)
        if not any(_misfits(off)):
            break
    return Fit(minimum.state, off, minimum.covariance, trial.detection, trial.rejected)


def _best_lens(detection: Detection, points: Array, start: Start) -> Array:
    """Return that one of the starting lenses from which a few frames are fitted best."""
    if len(start.lenses) == 1:
        return start.lenses[0]
    few = replace(
        detection, sightings=tuple(detection.sightings[i] for i in spread(len(detection.sightings), _FRAMES_TO_CHOOSE))
    )
    left_over: list[float] = []
    failure: CalibrationError | None = None
    for lens in start.lenses:
        try:
            trial = _placed(few, points, start.model, lens, start.right)
            require_frames(len(trial.detection.sightings), start.model, trial.rejected)
            off = residuals(start.model, points, trial.detection.pixels(), _annealed(start.model, points, trial))
            left_over.append(float(np.median(np.linalg.norm(off, axis=-1))))
        except CalibrationError as error:
            failure = error
            left_over.append(np.inf)
    if failure is not None and not np.isfinite(left_over).any():
        raise failure
    return start.lenses[int(np.nanargmin(left_over))]


def _annealed(model: LensModel, points: Array, trial: _Trial) -> Unknowns:
    """Fit robustly, first with a tolerance as wide as the start is off, then with ever narrower ones."""
    unknowns, pixels = trial.unknowns, trial.detection.pixels()
    last = np.inf
    for _ in range(_ANNEALINGS):
        off = np.linalg.norm(residuals(model, points, pixels, unknowns), axis=-1)
        tolerance = max(_TOLERANCE_TIMES * float(np.median(off)), _LEAST_TOLERANCE_PX)
        if tolerance > last / 2:
            break
        try:
            unknowns = adjust(
                model, points, pixels, unknowns, tolerance_px=tolerance, most_rounds=_ANNEALING_ROUNDS
            ).state
        except np.linalg.LinAlgError as error:
            raise CalibrationError(f"the frames do not determine the cameras: {_TILT}") from error
        last = tolerance
    return unknowns


def _misfits(residuals_px: Array) -> list[str | None]:
    """Say for each frame why it must go, or None where it fits."""
    rms = np.sqrt(np.mean(np.sum(residuals_px**2, axis=-1), axis=(1, 2)))
    limit, median = outlier_limit(rms), float(np.median(rms))
    return [f"corners are {value:.2f} px off, others {median:.2f}" if value > limit else None for value in rms]


def _placed(detection: Detection, points: Array, model: LensModel, lens: Array, right: Pose | None) -> _Trial:
    """Place the board in every frame by the starting lens; a frame whose two views contradict the others goes."""
    pixels, lenses = detection.pixels(), model.lenses(lens)
    left = [board_poses(points, view, lenses[0]) for view in pixels[:, 0]]
    consensus = agreed(left, [board_poses(points, view, lenses[1]) for view in pixels[:, 1]])
    tries = [
        (*_chosen(points, pixels, lenses, left, pose), pose) for pose in (consensus.pose, right) if pose is not None
    ]
    poses, errors, right_pose = min(tries, key=lambda each: float(np.median(each[1])))
    why: list[str | None] = []
    for off, error in zip(consensus.off_deg, errors, strict=True):
        turned = f"its views disagree with the others by {off:.0f} degrees (corners in another order?)"
        unseen = None if np.isfinite(error) else "no pose of the board fits it"
        why.append(turned if off >= _TURNED_DEG else unseen)
    R, t = np.stack([pose.R for pose in poses]), np.stack([pose.t for pose in poses])
    return _Trial(detection, Unknowns(lens, right_pose, R, t), detection.rejected).without(why)


def _chosen(
    points: Array, pixels: Array, lenses: tuple[Lens, Lens], left: list[tuple[Pose, ...]], right: Pose
) -> tuple[list[Pose], Array]:
    """Choose each frame's board pose by what both views say under one relative pose; errors (V,) in pixels, rms."""
    chosen, errors = [], []
    for frame, candidates in zip(pixels, left, strict=True):
        best, least = Pose(np.eye(3), np.zeros(3)), np.inf
        for pose in candidates:
            in_left = points @ pose.R.T + pose.t
            in_right = in_left @ right.R.T + right.t
            off = np.stack([lenses[0].project(in_left), lenses[1].project(in_right)]) - frame
            error = float(np.sqrt(np.sum(off**2) / len(points)))
            if error < least:  # never true for NaN: behind a lens
                best, least = pose, error
        chosen.append(best)
        errors.append(least)
    return chosen, np.array(errors)
