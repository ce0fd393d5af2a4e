"""Fit a lens model to the frames that agree, and name the frames and corners that do not.

Place the board in every frame -> a robust fit that one bad frame cannot pull along -> frames and corners that do not fit are
dropped by name -> plain least squares on the rest -> again, until everything fits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import Detection, Rejection
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.solving.bundle import LensModel, Unknowns, adjust, residuals
from prismstereo_calibration.solving.first_guess import spread
from prismstereo_calibration.solving.placing import place
from prismstereo_calibration.solving.poses import Pose

__all__ = ["Fit", "RejectedCorner", "Start", "fit_frames", "outlier_limit", "require_frames"]

Array = NDArray[np.float64]

_OUTLIER_TIMES, _OUTLIER_PX = 3.0, 0.5
_MOST_ROUNDS = 6
_CORNER_TIMES, _CORNER_PX = 5.0, 1.0  # of the noise per axis: one corner in 270 000 is farther off by chance
_RAYLEIGH_MEDIAN = 1.1774  # median distance of two-dimensional noise, over the noise per axis
_MOST_CORNERS = 0.2  # of a frame's corners: beyond, the frame is wrong and not its corners
_TOLERANCE_TIMES, _LEAST_TOLERANCE_PX = 3.0, 0.5
_ANNEALINGS, _ANNEALING_ROUNDS = 5, 30
_FRAMES_TO_CHOOSE = 12
_TILT = "tilt the board 20 to 40 degrees in different directions, near and far"


@dataclass(frozen=True, slots=True)
class Start:
    """A lens model, its numbers to start from, and the poses of the other views where a rig tells them in the board's unit.

    Of several starts the one that leads to the best fit of a few frames is taken.
    """

    model: LensModel
    lenses: tuple[Array, ...]
    others: tuple[Pose, ...] | None


@dataclass(frozen=True, slots=True)
class RejectedCorner:
    """A corner that does not count: of which frame and view (0 is the left one), its number, how far off in pixels."""

    name: str
    view: int
    corner: int
    off_px: float


@dataclass(frozen=True, slots=True)
class Fit:
    """The unknowns of least squares over the frames of `detection`, in its order, and what was rejected on the way.

    Rejected corners are NaN in `detection`. `residuals_px` are projected minus measured (V, K, N, 2), NaN where nothing was
    measured; `covariance` is that of lens numbers, of turn (rad) and shift of every other view, and of the warp.
    """

    unknowns: Unknowns
    residuals_px: Array
    covariance: Array
    detection: Detection
    rejected: tuple[Rejection, ...]
    rejected_corners: tuple[RejectedCorner, ...]
    rounds: int


@dataclass(frozen=True, slots=True)
class _Trial:
    """The frames still in, and where everything stands by now."""

    detection: Detection
    unknowns: Unknowns
    rejected: tuple[Rejection, ...]
    corners: tuple[RejectedCorner, ...] = ()

    def without(self, why: list[str | None]) -> _Trial:
        """Leave out the frames for which there is a reason."""
        seen, state = self.detection.sightings, self.unknowns
        good = np.array([reason is None for reason in why])
        gone = tuple(Rejection(one.name, reason) for one, reason in zip(seen, why, strict=True) if reason is not None)
        left_out = {one.name for one in gone}
        return _Trial(
            replace(self.detection, sightings=tuple(one for one, ok in zip(seen, good, strict=True) if ok)),
            replace(
                state,
                R_left_from_board=state.R_left_from_board[good],
                t_left_from_board=state.t_left_from_board[good],
            ),
            self.rejected + gone,
            tuple(corner for corner in self.corners if corner.name not in left_out),
        )

    def without_corners(self, off_px: Array) -> _Trial:
        """Leave out the corners that stand out of the noise; `off_px` (V, K, N) is NaN where nothing was measured."""
        bad = off_px > _corner_limit(off_px)
        if not bad.any():
            return self
        sightings = list(self.detection.sightings)
        gone = []
        for frame in np.flatnonzero(bad.any(axis=(1, 2))):
            sightings[frame] = replace(
                sightings[frame], pixels=np.where(bad[frame][..., None], np.nan, sightings[frame].pixels)
            )
        for frame, view, corner in np.argwhere(bad):
            off = float(off_px[frame, view, corner])
            gone.append(RejectedCorner(sightings[frame].name, int(view), int(corner), off))
        detection = replace(self.detection, sightings=tuple(sightings))
        return replace(self, detection=detection, corners=(*self.corners, *gone))


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
    trial = _placed(detection, points, start, lens)
    trial = replace(trial, unknowns=_annealed(model, points, trial))
    rounds = 0
    for _ in range(_MOST_ROUNDS):
        trial = _cleaned(trial, model, points)
        pixels = trial.detection.pixels()
        try:
            minimum = adjust(model, points, pixels, trial.unknowns)
        except np.linalg.LinAlgError as error:
            raise CalibrationError(f"the frames do not determine the cameras: {_TILT}") from error
        trial, rounds = replace(trial, unknowns=minimum.state), rounds + minimum.rounds
        if _cleaned(trial, model, points) is trial:
            break
    off = residuals(model, points, trial.detection.pixels(), minimum.state)
    return Fit(minimum.state, off, minimum.covariance, trial.detection, trial.rejected, trial.corners, rounds)


def _cleaned(trial: _Trial, model: LensModel, points: Array) -> _Trial:
    """Leave out the frames that do not fit and, where all do, the corners; the trial itself where all is well."""
    off = residuals(model, points, trial.detection.pixels(), trial.unknowns)
    why = _misfits(off)
    if any(why):
        trial = trial.without(why)
        require_frames(len(trial.detection.sightings), model, trial.rejected)
        return trial
    return trial.without_corners(np.linalg.norm(off, axis=-1))


def _best_lens(detection: Detection, points: Array, start: Start) -> Array:
    """Return that one of the starting lenses from which a few frames are fitted best."""
    if len(start.lenses) == 1:
        return start.lenses[0]
    seen = detection.sightings
    few = replace(detection, sightings=tuple(seen[i] for i in spread(len(seen), _FRAMES_TO_CHOOSE)))
    left_over: list[float] = []
    failure: CalibrationError | None = None
    for lens in start.lenses:
        try:
            trial = _placed(few, points, start, lens)
            off = residuals(start.model, points, trial.detection.pixels(), _annealed(start.model, points, trial))
            left_over.append(float(np.nanmedian(np.linalg.norm(off, axis=-1))))
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
        tolerance = max(_TOLERANCE_TIMES * float(np.nanmedian(off)), _LEAST_TOLERANCE_PX)
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
    off_px = np.linalg.norm(residuals_px, axis=-1)
    beyond, seen = off_px > _corner_limit(off_px), np.isfinite(off_px)
    few = np.count_nonzero(beyond, axis=(1, 2)) <= _MOST_CORNERS * np.count_nonzero(seen, axis=(1, 2))
    counted = seen & ~(beyond & few[:, None, None])  # a few mistaken corners are left out one by one
    rms = np.sqrt(np.sum(np.where(counted, off_px, 0) ** 2, axis=(1, 2)) / np.count_nonzero(counted, axis=(1, 2)))
    limit, median = outlier_limit(rms), float(np.median(rms))
    return [f"corners are {value:.2f} px off, others {median:.2f}" if value > limit else None for value in rms]


def _corner_limit(off_px: Array) -> float:
    """Return the distance in pixels beyond which a corner stands out of the noise."""
    return max(_CORNER_TIMES * float(np.nanmedian(off_px)) / _RAYLEIGH_MEDIAN, _CORNER_PX)


def _placed(detection: Detection, points: Array, start: Start, lens: Array) -> _Trial:
    """Place the board in every frame by a starting lens; a frame whose views contradict the others goes."""
    placing = place(detection.pixels(), points, start.model.lenses(lens), start.others)
    unknowns = Unknowns(lens, placing.others, placing.R_left_from_board, placing.t_left_from_board, np.zeros(2))
    trial = _Trial(detection, unknowns, detection.rejected).without(list(placing.doubts))
    require_frames(len(trial.detection.sightings), start.model, trial.rejected)
    return trial
