"""The triangulation gap: how closely the rays of one thing, found in each view by itself, pass each other.

A dense map cannot tell it, for two rays of one rectified row always meet. It is the part of the noise across the epipolar line,
so it shows the rows of a calibration and the noise of localisation, and is blind to errors of depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detect import detect
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.judging.triangulation import triangulate
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.uncalibrated.scene_matches import scene_matches
from prismstereo_hw.errors import ImageError
from prismstereo_hw.frame import RawFrame

__all__ = ["OUTLIER_SIGMAS", "Gap", "board_gap", "scene_gap"]

Array = NDArray[np.float64]

OUTLIER_SIGMAS = 5.0
_MAD = 1.4826  # standard deviation of half-normal values over their median


@dataclass(frozen=True, slots=True)
class Gap:
    """Mean and variance of the gaps of so many features, in mm and its square, at a mean distance; `what` they are of.

    `noise_px`: the noise per axis and view that would leave that mean gap.
    """

    what: str
    features: int
    distance_mm: float
    mean: float
    variance: float
    noise_px: float

    @classmethod
    def of(cls, what: str, calibration: Calibration, left_px: Array, right_px: Array) -> Gap | None:
        """Triangulate features (N, 2) in upright pixels of both views; None where no ray of theirs meets another.

        Gaps beyond `OUTLIER_SIGMAS` of the others are those of different things that look alike, and do not count.
        """
        points, gaps = triangulate(calibration, left_px, right_px)
        seen = np.isfinite(gaps) & (points[..., 2] > 0)
        if seen.any():
            share = np.where(seen, gaps / np.where(seen, points[..., 2], 1.0), np.inf)
            seen &= share <= max(OUTLIER_SIGMAS * _MAD * float(np.median(share[seen])), 1e-12)
        if not seen.any():
            return None
        mean, away = float(gaps[seen].mean()), float(points[seen][:, 2].mean())
        noise_px = mean * calibration.focal_px / away / (2 / np.sqrt(np.pi))  # half-normal of both views' noise
        return cls(what, int(seen.sum()), away, mean, float(gaps[seen].var()), float(noise_px))


def scene_gap(calibration: Calibration, frames: Sequence[RawFrame]) -> Gap | None:
    """Find features of any texture in both views of raw frames; None where there are too few of them."""
    named = [NamedFrame(f"frame {frame.index}", frame.pixels) for frame in frames]
    try:
        found = scene_matches(named, calibration.views, rectification(calibration))
    except ImageError:
        return None
    return Gap.of("features of the scene", calibration, found.left, found.right)


def board_gap(calibration: Calibration, frames: Sequence[RawFrame], board: Board) -> Gap | None:
    """Find the corners of a board in both views of raw frames; `CalibrationError` where no frame shows it in both."""
    named = [NamedFrame(f"frame {frame.index}", frame.pixels) for frame in frames]
    pixels = detect(named, calibration.views, board).pixels()
    return Gap.of("corners of the board", calibration, pixels[:, 0].reshape(-1, 2), pixels[:, 1].reshape(-1, 2))
