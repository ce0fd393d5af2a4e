"""From video to still: scale and shift between two modes of one camera, from the same board poses taken in both.

Both modes read the same sensor behind the same lens, so the way from one to the other has three numbers and no more:
x_still = scale x_video + shift_x, y alike, in raw-frame pixels. Wherever a picture is cropped and resized by s, the shift is
s / 2 - 1 / 2 plus that of the crop, because pixel (0, 0) is the CENTRE of the top-left pixel. The same corners also allow a
homography, which has five numbers more: where it wants to differ, the camera moved or the modes are not of one lens.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.detection import Detection, Rejection, Sighting
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.outputs import Output

__all__ = ["ModeMatch", "still_to_video"]

Array = NDArray[np.float64]

_LEAST_CORNERS = 12
_LEAST_REACH = 0.05  # of the video frame's width: corners closer together than that tell no scale
_ROUNDS = 10
_SIEVES = 4
_HUBER = 1.345  # deviations: beyond, a corner pulls no harder
_LEAST_SHIFT_PX = 0.5  # still pixels by which a view's corners may go astray together
_LEAST_RMS_PX = 1.0
_ODD_SHIFT, _ODD_RMS = 4.0, 3.0  # times the median frame
_MOST_HOMOGRAPHY_PX = 1.0
_MOST_CORNER_PX = 1.0  # of a corner in either mode, in its own pixels
_CHECKS = 5  # points a side where the homography is compared


@dataclass(frozen=True, slots=True)
class ModeMatch:
    """How a still mode lies to the calibrated video mode, and what speaks for it.

    `output` has scale, shift and rms, in still pixels per two-dimensional point. `homography_px` is how far a free homography
    differs from it at most where corners were seen, in still pixels. `rejected` are the frames in which the board, or the
    rig, moved between the two pictures.
    """

    output: Output
    homography_px: float
    frames_used: int
    corners_used: int
    rejected: tuple[Rejection, ...]


@dataclass(frozen=True, slots=True)
class _Pairs:
    """The corners of one pose that both modes show: raw video and raw still pixels (N, 2), and the view (N,) of each."""

    name: str
    video: Array
    still: Array
    view: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class _Similarity:
    """Scale and shift (2,) from video to still pixels."""

    scale: float
    shift: Array

    def residual(self, pairs: _Pairs) -> Array:
        """Return what is left of each corner, (N, 2) still pixels."""
        return np.asarray(pairs.still - self.scale * pairs.video - self.shift)


def still_to_video(video: Detection, still: Detection, name: str = "still") -> ModeMatch:
    """Measure scale and shift from video to still frames, from frames of the same name (or number) in both detections.

    Corners of both views count together. `CalibrationError` where no frame is in both, most of them moved, the corners are
    too few or too close together, and where a homography fits better by more than a still pixel.
    """
    poses = _common(video, still)
    _require_spread(_pooled(poses), video.frame_width)
    found, kept, rejected = _without_moved(poses, _consensus(poses))
    pooled = _pooled(kept)
    rms_px = _rms(found.residual(pooled))
    most_px = _MOST_CORNER_PX * (1 + found.scale)
    if rms_px > most_px:
        raise CalibrationError(
            f"the corners of video and {name} agree to {rms_px:.1f} px only, and {most_px:.1f} is the most: a sharp board at "
            "rest does better; take both pictures of each pose again"
        )
    homography_px = _homography_px(found, pooled)
    if homography_px > _MOST_HOMOGRAPHY_PX:
        raise CalibrationError(
            f"a free homography from video to {name} differs by {homography_px:.2f} px from a scale and a shift, and "
            f"{_MOST_HOMOGRAPHY_PX:g} is the most: the board or the camera moved between the two pictures, or the modes are of "
            "two lenses; take both with the rig on a table, and neither focus nor zoom touched"
        )
    output = Output(
        name=name,
        width=still.frame_width,
        height=still.frame_height,
        scale=found.scale,
        shift_x_px=float(found.shift[0]),
        shift_y_px=float(found.shift[1]),
        rms_px=rms_px,
    )
    return ModeMatch(output, homography_px, len(kept), len(pooled.video), tuple(rejected))


def _common(video: Detection, still: Detection) -> list[_Pairs]:
    """Pair the corners of frames that have the same name, but for folder and ending."""
    stills = {PurePath(one.name).stem: one for one in still.sightings}
    both = [(one, stills[PurePath(one.name).stem]) for one in video.sightings if PurePath(one.name).stem in stills]
    poses = [_pairs(video, one, still, other) for one, other in both]
    poses = [pairs for pairs in poses if len(pairs.video) >= _LEAST_CORNERS]
    if not poses:
        raise CalibrationError(
            f"no board pose shows {_LEAST_CORNERS} corners in video and still alike ({len(video.sightings)} video frames and "
            f"{len(still.sightings)} stills show the board, {len(both)} have the same name): take each pose in both modes and "
            "give the pictures the same number"
        )
    return poses


def _pairs(video: Detection, one: Sighting, still: Detection, other: Sighting) -> _Pairs:
    if one.pixels.shape != other.pixels.shape:
        raise CalibrationError(
            f"{one.name} has corners {one.pixels.shape[:2]} (views, corners) in the video and {other.pixels.shape[:2]} in the "
            "still: both modes must show the same board through the same views"
        )
    places, points = [], []
    for detection, sighting in ((video, one), (still, other)):
        size = detection.frame_width, detection.frame_height
        raw = [view.raw_from_upright(seen, *size) for view, seen in zip(detection.views, sighting.pixels, strict=True)]
        places.append(np.concatenate(raw))
    seen = np.isfinite(places[0]).all(axis=1) & np.isfinite(places[1]).all(axis=1)
    points = [place[seen] for place in places]
    view = np.repeat(np.arange(len(one.pixels)), one.pixels.shape[1])[seen]
    return _Pairs(one.name, points[0], points[1], view)


def _pooled(poses: list[_Pairs]) -> _Pairs:
    return _Pairs(
        "all",
        np.concatenate([pairs.video for pairs in poses]),
        np.concatenate([pairs.still for pairs in poses]),
        np.concatenate([pairs.view for pairs in poses]),
    )


def _fit(pairs: _Pairs) -> _Similarity:
    """Fit scale and shift by least squares; corners far off (Huber) pull no harder than those at the edge of the many."""
    weight = np.ones(len(pairs.video))
    found = _Similarity(1.0, np.zeros(2))
    for _ in range(_ROUNDS):
        a, b = (np.average(points, axis=0, weights=weight) for points in (pairs.video, pairs.still))
        from_a = pairs.video - a
        scale = float(np.sum(weight[:, None] * from_a * (pairs.still - b)) / np.sum(weight[:, None] * from_a**2))
        found = _Similarity(scale, b - scale * a)
        off = np.linalg.norm(found.residual(pairs), axis=1)
        limit = _HUBER * 1.2 * float(np.median(off)) + 1e-9  # the median length of plain noise is 1.18 deviations
        weight = np.minimum(1.0, limit / np.maximum(off, 1e-12))
    return found


def _consensus(poses: list[_Pairs]) -> _Similarity:
    """Return the similarity of that single pose on which the poses agree best: least median of their errors.

    One in two poses may have moved and does not spoil it, as it would a common fit.
    """
    candidates = [_fit(pairs) for pairs in poses]
    medians = [_middle([_rms(fit.residual(pairs)) for pairs in poses]) for fit in candidates]
    return candidates[int(np.argmin(medians))]


def _without_moved(poses: list[_Pairs], start: _Similarity) -> tuple[_Similarity, list[_Pairs], list[Rejection]]:
    """Fit all poses that stood still together; return the fit, those poses, and why the others do not count."""
    found, kept, rejected = start, poses, list[Rejection]()
    for _ in range(_SIEVES):
        shifts = [_common_shift(found, pairs) for pairs in poses]
        errors = [_rms(found.residual(pairs)) for pairs in poses]
        shift_limit = max(_LEAST_SHIFT_PX, _ODD_SHIFT * _middle(shifts))
        rms_limit = max(_LEAST_RMS_PX, _ODD_RMS * _middle(errors))
        kept, rejected = [], []
        for pairs, shift, rms in zip(poses, shifts, errors, strict=True):
            if shift <= shift_limit and rms <= rms_limit:
                kept.append(pairs)
            else:
                why = f"the board or the rig moved between video and still, by {shift:.1f} px of the still (rms {rms:.1f} px)"
                rejected.append(Rejection(pairs.name, why))
        if 2 * len(kept) <= len(poses):
            raise CalibrationError(
                f"{len(rejected)} of {len(poses)} poses moved between video and still ({rejected[0].name}: "
                f"{rejected[0].reason}): fix board and rig, and take both pictures of each pose again"
            )
        found = _fit(_pooled(kept))
    return found, kept, rejected


def _common_shift(fit: _Similarity, pairs: _Pairs) -> float:
    """Return how far the corners of a view are astray together, in still pixels; of the views, the worst."""
    residual = fit.residual(pairs)
    views = np.unique(pairs.view)
    return max(float(np.linalg.norm(np.median(residual[pairs.view == view], axis=0))) for view in views)


def _middle(values: list[float]) -> float:
    """Return the median, of an even number the lower one: half of the poses may be anything."""
    return sorted(values)[(len(values) - 1) // 2]


def _rms(residual: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def _require_spread(pooled: _Pairs, frame_width: int) -> None:
    reach = float(np.ptp(pooled.video, axis=0).min())
    if reach < _LEAST_REACH * frame_width:
        raise CalibrationError(
            f"the corners reach over {reach:.0f} of {frame_width} pixels of the video frame, and a scale needs "
            f"{_LEAST_REACH * frame_width:.0f} in width and height: hold the board nearer, or in more places"
        )


def _homography_px(fit: _Similarity, pooled: _Pairs) -> float:
    """Return by how much a free homography differs at most, over the rectangle in which corners were seen."""
    H = np.asarray(cv2.findHomography(pooled.video, pooled.still, 0)[0], np.float64)
    low, high = pooled.video.min(axis=0), pooled.video.max(axis=0)
    across, down = (np.linspace(a, b, _CHECKS) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    free = np.column_stack([grid, np.ones(len(grid))]) @ H.T
    straight = fit.scale * grid + fit.shift
    return float(np.linalg.norm(free[:, :2] / free[:, 2:] - straight, axis=1).max())
