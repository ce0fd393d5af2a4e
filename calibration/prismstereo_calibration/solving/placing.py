"""Where the board stands in every frame, and how the views stand to each other, before anything is adjusted.

Glass is left out here: it moves a pinhole by some millimetres, which the adjustment puts right at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.solving.poses import Consensus, Pose, agreed, board_poses
from prismstereo_hw.lens import Lens

__all__ = ["Placing", "place"]

Array = NDArray[np.float64]
Candidates = list[tuple[Pose, ...]]

_TURNED_DEG = 30.0  # how far a frame's relative pose may be off by noise and the two-fold pose of a flat board
_FEWEST_CORNERS = 4  # of a view that says anything about the board's pose


@dataclass(frozen=True, slots=True)
class Placing:
    """Poses of the other views from the first, of the board in V frames, and why a frame must go (None where it fits)."""

    others: tuple[Pose, ...]
    R_left_from_board: Array
    t_left_from_board: Array
    doubts: tuple[str | None, ...]


def place(pixels: Array, points: Array, lenses: tuple[Lens, ...], promised: tuple[Pose, ...] | None) -> Placing:
    """Place boards, points (N, 3), by their pixels (V, K, N, 2) in K views with these lenses.

    The poses of the other views are those that the frames agree on, or the `promised` ones if they fit better.
    `CalibrationError` where a view never shows the board together with the first one.
    """
    candidates = [[_candidates(points, frame[view], lens) for frame in pixels] for view, lens in enumerate(lenses)]
    agreements = [_agreement(candidates[0], candidates[view], view) for view in range(1, len(lenses))]
    tries = [tuple(agreement.pose for agreement, _ in agreements)]
    tries += [] if promised is None else [promised]
    placed = [(*_chosen(points, pixels, lenses, candidates[0], others), others) for others in tries]
    poses, errors, others = min(placed, key=lambda each: float(np.median(each[1])))
    off_deg = np.zeros(len(pixels))
    for agreement, together in agreements:
        off_deg[together] = np.maximum(off_deg[together], agreement.off_deg)
    return Placing(
        others,
        np.stack([pose.R for pose in poses]),
        np.stack([pose.t for pose in poses]),
        tuple(_doubt(off, error) for off, error in zip(off_deg, errors, strict=True)),
    )


def _doubt(off_deg: float, error_px: float) -> str | None:
    if off_deg >= _TURNED_DEG:
        return f"its views disagree with the others by {off_deg:.0f} degrees (corners in another order?)"
    return None if np.isfinite(error_px) else "no pose of the board fits it"


def _candidates(points: Array, pixels: Array, lens: Lens) -> tuple[Pose, ...]:
    """Return the poses of a board that a view of it allows: none where it shows too few corners."""
    shown = np.isfinite(pixels).all(axis=-1)
    return board_poses(points[shown], pixels[shown], lens) if np.count_nonzero(shown) >= _FEWEST_CORNERS else ()


def _agreement(first: Candidates, other: Candidates, view: int) -> tuple[Consensus, NDArray[np.intp]]:
    """Return what the frames that show the board in both views agree on, and which frames those are."""
    together = np.array([i for i, (a, b) in enumerate(zip(first, other, strict=True)) if a and b], np.intp)
    if not together.size:
        raise CalibrationError(
            f"no frame shows the board in the left view and in view {view + 1} in a pose that can be: check the board's "
            "size and the frames"
        )
    return agreed([first[i] for i in together], [other[i] for i in together]), together


def _chosen(
    points: Array, pixels: Array, lenses: tuple[Lens, ...], first: Candidates, others: tuple[Pose, ...]
) -> tuple[list[Pose], Array]:
    """Choose each frame's board pose by what all views say under one relative pose; errors (V,) in pixels, rms."""
    views = (Pose(np.eye(3), np.zeros(3)), *others)
    chosen, errors = [], []
    for frame, candidates in zip(pixels, first, strict=True):
        best, least = Pose(np.eye(3), np.zeros(3)), np.inf
        shown = np.isfinite(frame).all(axis=-1)
        for pose in candidates:
            in_left = points @ pose.R.T + pose.t
            seen = [lens.project(in_left @ view.R.T + view.t) for lens, view in zip(lenses, views, strict=True)]
            off = np.where(shown[..., None], np.stack(seen) - frame, 0.0)
            error = float(np.sqrt(np.sum(off**2) / np.count_nonzero(shown)))
            if error < least:  # never true for NaN: behind a lens
                best, least = pose, error
        chosen.append(best)
        errors.append(least)
    return chosen, np.array(errors)
