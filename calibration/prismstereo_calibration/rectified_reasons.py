"""Static reasons in rectified pixels: why there can be no disparity there, whatever the scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.rectification import Rectification
from prismstereo_calibration.static_mask import StaticMask, StaticReason
from prismstereo_hw.view import Side

__all__ = ["rectified_reasons"]


def rectified_reasons(mask: StaticMask, rectification: Rectification, side: Side) -> NDArray[np.uint8]:
    """Return the reason of every rectified pixel of a view, (height, width) uint8: that of the nearest pixel it comes from.

    Where the rectified picture shows nothing of the view, that is `OUTSIDE`.
    """
    sources = rectification.sources(rectification.left if side == "left" else rectification.right)
    seen = np.isfinite(sources[..., 0])
    nearest = np.rint(sources[seen]).astype(np.intp)
    reasons = np.full(seen.shape, StaticReason.OUTSIDE, np.uint8)
    reasons[seen] = mask.of(side)[nearest[:, 1], nearest[:, 0]]
    return reasons
