"""How the camera itself moved between two pictures: the homography that most of the scene obeys."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.features import Features
from prismstereo.fusion.motion.models import FlatMotion
from prismstereo.fusion.motion.selection import best_fit

__all__ = ["shake"]

_FEWEST = 24
_AT_REST_PX = 0.12  # a corner that moves less is not worth another interpolation
_FURTHEST = 0.1  # of the width: more is another scene, not shake


def shake(background: Features, picture: Features, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from pixels of the background to those of a picture of `shape` (height, width).

    The identity where the camera stood still, and where too little is seen of the background to tell.
    """
    fit = best_fit(background.matched(picture))
    if fit is None or fit.support < _FEWEST or not isinstance(fit.model, FlatMotion):
        return np.eye(3)
    height, width = shape[:2]
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], np.float64)
    furthest = float(np.hypot(*(fit.model.in_frame(corners) - corners).T).max())
    if furthest < _AT_REST_PX or furthest > _FURTHEST * width:
        return np.eye(3)
    return fit.model.frame_from_still
