"""How far a thing moved while the frame was exposed: the streak that makes the still look most like the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.likeness import TURNED, unlikeness
from prismstereo.fusion.motion.picture import grey

__all__ = ["Streak", "streak_of"]

Float = NDArray[np.float32]
_LENGTHS_PX = (3.0, 5.0, 8.0, 12.0)
_ANGLES = 8
_SHARP = 0.35  # times noise, on average: nothing is left to explain
_WORTH = 0.9  # of the residual: a streak must leave that much less over


@dataclass(frozen=True, slots=True)
class Streak:
    """A straight streak, length in video pixels and angle in degrees; length 0 is none."""

    length_px: float = 0.0
    angle_deg: float = 0.0

    def kernel(self, factor: float = 1.0) -> Float:
        """Return the streak as a filter (n, n) float32 of sum 1, for a picture with `factor` pixels for one of the video."""
        half = self.length_px * factor / 2
        reach = math.ceil(half)
        steps = 8 * max(1, reach)
        along = (np.arange(steps) + 0.5) / steps * 2 * half - half
        angle = math.radians(self.angle_deg)
        kernel = np.zeros((2 * reach + 3, 2 * reach + 3), np.float32)
        for step in along:
            x, y = reach + 1 + step * math.cos(angle), reach + 1 + step * math.sin(angle)
            column, row = int(x), int(y)
            right, down = x - column, y - row
            kernel[row : row + 2, column : column + 2] += np.outer([1 - down, down], [1 - right, right]).astype(
                np.float32
            )
        return np.asarray(kernel / kernel.sum(), np.float32)

    def over(self, picture: Float, factor: float = 1.0) -> Float:
        """Return a picture as it looks through the streak, (height, width[, c]) float32."""
        if not self.length_px:
            return picture
        return np.asarray(cv2.filter2D(picture, cv2.CV_32F, self.kernel(factor)), np.float32)


def streak_of(frame: Float, model: Float, inside: NDArray[np.bool_], noise: float) -> Streak:
    """Find the streak that takes `model` to `frame`, both (height, width[, c]) and registered, judged where `inside` holds."""
    if inside.sum() < 30:
        return Streak()
    ours, sharp = grey(frame), grey(model)

    def left(streak: Streak) -> float:
        score = unlikeness(ours, streak.over(sharp), TURNED, noise=noise, slack_px=0.1)
        return float(np.minimum(score[inside], 25).mean())

    best, least = Streak(), left(Streak())
    if least < _SHARP:
        return best
    first = least
    for length in _LENGTHS_PX:
        found = min(((left(s), s) for s in _turned(length)), key=lambda pair: pair[0])
        if found[0] >= least:
            break
        least, best = found
    return best if least < _WORTH * first else Streak()


def _turned(length: float) -> list[Streak]:
    return [Streak(length, 180.0 * turn / _ANGLES) for turn in range(_ANGLES)]
