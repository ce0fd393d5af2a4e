"""Feature points of pictures, and which of two pictures' points look alike."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Features", "Matches"]

Float = NDArray[np.float32]
Points = NDArray[np.float64]
_CONTRAST = 0.02
_RATIO = 0.85
_MOST_OF_SCENE = 800


@dataclass(frozen=True, slots=True)
class Matches:
    """Points of one picture (n, 2) and where they were found in another (n, 2), video pixels, float64."""

    ours: Points
    theirs: Points

    def __len__(self) -> int:
        return len(self.ours)

    def chosen(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Matches:
        """Return some of the matches."""
        return Matches(self.ours[which], self.theirs[which])


@dataclass(frozen=True, slots=True)
class Features:
    """SIFT points (n, 2) in video pixels, strongest first, and their descriptors (n, 128) float32."""

    points: Points
    descriptors: Float

    @classmethod
    def of_scene(cls, grey: Float) -> Features:
        """Find what tells how the camera moved: the strongest features of a whole video picture."""
        return cls.of(grey, most=_MOST_OF_SCENE)

    @classmethod
    def of(
        cls, grey: Float, *, mask: NDArray[np.bool_] | None = None, factor: int = 1, blur_px: float = 0.0, most: int = 3000
    ) -> Features:  # fmt: skip
        """Find the features of a picture (height, width) that has `factor` pixels for one of the video, where `mask` holds.

        `mask` is of the picture's size; `blur_px`, in the picture's pixels, smooths it first. At `most` so many, the strongest.
        """
        pixels = cv2.GaussianBlur(grey, (0, 0), blur_px) if blur_px else grey
        left, top, right, bottom = _box(mask, grey.shape)
        if right - left < 8 or bottom - top < 8:
            return cls(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
        cut = np.clip(np.rint(pixels[top:bottom, left:right]), 0, 255).astype(np.uint8)
        where = None if mask is None else np.ascontiguousarray(mask[top:bottom, left:right], np.uint8) * 255
        found, descriptors = cv2.SIFT.create(most, contrastThreshold=_CONTRAST).detectAndCompute(cut, where)
        if descriptors is None or not len(found):
            return cls(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
        places = np.array([point.pt for point in found], np.float64) + np.array([left, top])
        return cls((places + 0.5) / factor - 0.5, np.asarray(descriptors, np.float32))

    def matched(self, other: Features) -> Matches:
        """Match these points to those of another picture: the nearest, where it is clearly nearer than the next."""
        if len(self.points) < 2 or len(other.points) < 2:
            return Matches(np.zeros((0, 2)), np.zeros((0, 2)))
        # not FLANN: its trees are random
        pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(self.descriptors, other.descriptors, k=2)
        good = [
            (first.queryIdx, first.trainIdx) for first, second in pairs if first.distance < _RATIO * second.distance
        ]
        chosen = np.array(good, np.intp).reshape(-1, 2)
        return Matches(self.points[chosen[:, 0]], other.points[chosen[:, 1]])


def _box(mask: NDArray[np.bool_] | None, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of what a mask keeps, with room for the features' surroundings."""
    height, width = shape[:2]
    if mask is None:
        return 0, 0, width, height
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    if not columns.size:
        return 0, 0, 0, 0
    margin = 24
    return (
        max(0, int(columns[0]) - margin),
        max(0, int(rows[0]) - margin),
        min(width, int(columns[-1]) + 1 + margin),
        min(height, int(rows[-1]) + 1 + margin),
    )
