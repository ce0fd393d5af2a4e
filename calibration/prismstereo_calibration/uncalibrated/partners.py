"""Points of two pictures that are each other's only likeness: SIFT features, wherever in the other picture they lie."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import ImageError

__all__ = ["partners"]

Array = NDArray[np.float64]

_DISTINCT = 0.8  # a partner must be so much nearer than the second best
_LEAST_FEATURES = 24


def partners(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    left_seen: NDArray[np.bool_] | None = None,
    right_seen: NDArray[np.bool_] | None = None,
    *,
    features: int,
    contrast: float = 0.04,
) -> tuple[Array, Array]:
    """Return points (N, 2) of the left and of the right grey picture that look alike, in pixels, to a fraction of one.

    At most `features` points of each picture are compared, the clearest ones, and only where it shows anything (`left_seen`,
    `right_seen`: (height, width)). `contrast` is how little a point may stand out (SIFT's threshold). `ImageError` names the
    view that has too little texture.
    """
    sift = cv2.SIFT.create(features, contrastThreshold=contrast)
    described = []
    for side, picture, seen in (("left", left, left_seen), ("right", right, right_seen)):
        mask = None if seen is None else seen.astype(np.uint8)
        points, words = sift.detectAndCompute(np.ascontiguousarray(picture), mask)
        if len(points) < _LEAST_FEATURES:
            raise ImageError(
                f"the {side} view shows {len(points)} points that could be found again, and {_LEAST_FEATURES} are needed: let "
                "the rig look at something with texture, in focus and well lit"
            )
        described.append((np.array([point.pt for point in points], float), words))
    (left_points, left_words), (right_points, right_words) = described
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(right_words, left_words)}
    kept = [
        (best.queryIdx, best.trainIdx)
        for best, second in matcher.knnMatch(left_words, right_words, k=2)
        if best.distance < _DISTINCT * second.distance and back[best.trainIdx] == best.queryIdx
    ]
    index = np.array(kept, int).reshape(-1, 2)
    return left_points[index[:, 0]], right_points[index[:, 1]]
