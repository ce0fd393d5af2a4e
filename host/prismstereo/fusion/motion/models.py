"""Models of how a rigid thing moved from the still to a video frame, and which of them the matches speak for.

All places are in video pixels (a still's too, as fractions). A flat thing, or a far one, moves by a similarity or a
homography; a thing with relief by a rotation and a translation in space, told from the disparity that the frame has at each
of its pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.features import Matches

__all__ = ["FlatMotion", "MotionModel", "Relief", "RigidMotion", "fit_flat", "fit_rigid"]

Float = NDArray[np.float32]
Points = NDArray[np.float64]
Matrix = NDArray[np.float64]
Kind = Literal["still", "similarity", "homography", "rigid"]
_RANSAC_ROUNDS = 5000
_NEARLY_INFINITE = 1e-3  # disparity, pixels


class MotionModel(Protocol):
    """Where the still shows what a frame shows."""

    @property
    def kind(self) -> Kind:
        """Which kind of motion it is."""

    @property
    def freedoms(self) -> int:
        """How many numbers were fitted."""

    def in_still(self, points: Points) -> Points:
        """Return where in the still (n, 2) the frame's points (n, 2) are; NaN where the model does not tell."""


@dataclass(frozen=True, slots=True)
class FlatMotion:
    """A motion in the picture plane: `frame_from_still` (3, 3)."""

    kind: Kind
    frame_from_still: Matrix

    @property
    def freedoms(self) -> int:
        """How many numbers were fitted: none, 4 or 8."""
        return {"still": 0, "similarity": 4, "homography": 8}.get(self.kind, 8)

    def in_still(self, points: Points) -> Points:
        """Return where in the still (n, 2) the frame's points (n, 2) are."""
        return _moved(np.asarray(np.linalg.inv(self.frame_from_still), np.float64), points)

    def in_frame(self, points: Points) -> Points:
        """Return where in the frame (n, 2) the still's points (n, 2) are."""
        return _moved(self.frame_from_still, points)


@dataclass(frozen=True, slots=True)
class Relief:
    """What the frame's disparity tells of depth: `disparity_px` (height, width), and the camera that it belongs to.

    `focal_px`, `cx_px` and `cy_px` are those of the rectified video picture. Lengths are in units of the baseline: depth is
    focal_px / (disparity_px + offset_px).
    """

    disparity_px: Float
    focal_px: float
    cx_px: float
    cy_px: float
    offset_px: float = 0.0

    @property
    def K(self) -> Matrix:
        """The camera matrix (3, 3)."""
        return np.array([[self.focal_px, 0, self.cx_px], [0, self.focal_px, self.cy_px], [0, 0, 1.0]])

    def continued(self, inside: NDArray[np.bool_]) -> Relief:
        """Return the relief of one thing alone: off `inside` (height, width), that of the nearest pixel inside.

        Around a thing the map has the ground's disparity, or a mixture; its outline must not be warped by that.
        """
        known = inside & np.isfinite(self.disparity_px)
        if not known.any():
            return self
        _, nearest = cv2.distanceTransformWithLabels(
            (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        values = np.zeros(int(nearest.max()) + 1, np.float32)
        values[nearest[known]] = self.disparity_px[known]
        return replace(self, disparity_px=values[nearest])

    def points(self, pixels: Points) -> Points:
        """Return the points (n, 3) in space that pixels (n, 2) show; NaN where there is no disparity."""
        parallax = _between(self.disparity_px, pixels) + self.offset_px
        depth = np.where(parallax > _NEARLY_INFINITE, self.focal_px / np.maximum(parallax, _NEARLY_INFINITE), np.nan)
        slopes = (pixels - np.array([self.cx_px, self.cy_px])) / self.focal_px
        return np.column_stack([slopes * depth[:, None], depth])


@dataclass(frozen=True, slots=True)
class RigidMotion:
    """A motion in space: X_still = R_still_from_frame X_frame + t, lengths in baselines, depth from `relief`."""

    R_still_from_frame: Matrix
    t_baselines: Points
    relief: Relief

    @property
    def kind(self) -> Kind:
        """Which kind of motion it is."""
        return "rigid"

    @property
    def freedoms(self) -> int:
        """How many numbers were fitted."""
        return 6

    def in_still(self, points: Points) -> Points:
        """Return where in the still (n, 2) the frame's points (n, 2) are; NaN where the frame has no depth."""
        moved = (self.relief.points(points) @ self.R_still_from_frame.T + self.t_baselines) @ self.relief.K.T
        ahead = np.where(moved[:, 2:] > 0, moved[:, 2:], np.nan)
        return np.asarray(moved[:, :2] / ahead)


def fit_flat(matches: Matches, kind: Literal["similarity", "homography"], reach_px: float) -> FlatMotion | None:
    """Fit a motion in the picture plane to most of the matches (still -> frame); None where they allow none."""
    ours, theirs = (p.astype(np.float64)[:, None] for p in (matches.ours, matches.theirs))
    if kind == "similarity":
        if len(matches) < 2:
            return None
        M, _ = cv2.estimateAffinePartial2D(
            ours, theirs, method=cv2.RANSAC, ransacReprojThreshold=reach_px, maxIters=_RANSAC_ROUNDS, confidence=0.999
        )
        return None if M is None else FlatMotion("similarity", np.vstack([M, [0, 0, 1]]))
    if len(matches) < 5:
        return None
    H, _ = cv2.findHomography(ours, theirs, cv2.USAC_MAGSAC, reach_px, maxIters=_RANSAC_ROUNDS, confidence=0.999)
    if H is None or not np.isfinite(H).all() or abs(np.linalg.det(H)) < 1e-9:
        return None
    return FlatMotion("homography", np.asarray(H, np.float64))


def fit_rigid(matches: Matches, relief: Relief, reach_px: float) -> RigidMotion | None:
    """Fit a motion in space to most of the matches (still -> frame), by the frame's depth; None where they allow none."""
    space = relief.points(matches.theirs)
    told = np.isfinite(space).all(axis=1)
    if told.sum() < 8:
        return None
    space, flat = space[told], matches.ours[told]
    try:
        found, turn, t, inliers = cv2.solvePnPRansac(
            space, flat, relief.K, None, iterationsCount=2000, reprojectionError=reach_px, confidence=0.999,
            flags=cv2.SOLVEPNP_EPNP,
        )  # fmt: skip
        if not found or inliers is None or len(inliers) < 8:
            return None
        kept = inliers.ravel()
        turn, t = cv2.solvePnPRefineLM(space[kept], flat[kept], relief.K, None, turn, t)
    except cv2.error:  # points that lie so that no pose follows from them
        return None
    return RigidMotion(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(t, np.float64).ravel(), relief)


def _between(picture: Float, points: Points) -> Points:
    """Interpolate a picture (height, width) at points (n, 2), drawn in to its rim: (n,) float64."""
    height, width = picture.shape
    x, y = np.clip(points[:, 0], 0, width - 1), np.clip(points[:, 1], 0, height - 1)
    column, row = np.minimum(x.astype(np.intp), width - 2), np.minimum(y.astype(np.intp), height - 2)
    right, down = x - column, y - row
    above = (1 - right) * picture[row, column] + right * picture[row, column + 1]
    below = (1 - right) * picture[row + 1, column] + right * picture[row + 1, column + 1]
    return np.asarray((1 - down) * above + down * below, np.float64)


def _moved(M: Matrix, points: Points) -> Points:
    flat = np.column_stack([points, np.ones(len(points))]) @ M.T
    return np.asarray(flat[:, :2] / flat[:, 2:])
