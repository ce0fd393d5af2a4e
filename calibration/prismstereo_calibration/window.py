"""The range window: which depths the searched disparities 0 .. labels - 1 stand for.

depth = F / (disparity + offset), F = focal_px * baseline. The far end lies at disparity 1 and the near end one pixel
below the last label (0 stays free for *unmatched* and noise at the far end is not clipped), so of near end, far end and
number of labels any two give the third.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.glass_parallax import GlassParallax
from prismstereo_hw.errors import UsageError

__all__ = ["DisparityWindow"]

_LABEL_STEP = 16  # what every matcher here counts in
_MOST_LABELS = 1024


@dataclass(frozen=True, slots=True)
class DisparityWindow:
    """Number of labels, and the offset that makes depth of disparity; lengths in the calibration's unit.

    `scale_px` is F = focal_px * baseline; 0 where the pair is not metric (two rectified pictures from anywhere). `glass` is
    what glass before the lens takes from the disparity of a picture of its size.
    """

    labels: int
    offset_px: float = 0.0
    scale_px: float = 0.0
    glass: GlassParallax | None = field(default=None, compare=False)

    @classmethod
    def between(cls, scale_px: float, near: float, far: float, labels: int | None = None) -> DisparityWindow:
        """Make the window from `near` to `far` (may be inf); given `labels` it reaches at least as near, or refuses."""
        if not 0 < near < far:
            raise UsageError(f"range {near:g}:{far:g} is empty: give near < far, both positive (far may be inf)")
        offset = (scale_px / far if math.isfinite(far) else 0.0) - 1.0
        reach = min(scale_px / near - offset, 1e9)  # a near end of next to nothing asks for any number
        needed = math.ceil(reach - 1e-9) + 2
        rounded = -(-needed // _LABEL_STEP) * _LABEL_STEP
        limit = _MOST_LABELS if labels is None else labels
        if limit > _MOST_LABELS:
            raise UsageError(f"{limit} disparity labels: search at most {_MOST_LABELS}")
        if needed > limit:
            last = limit - 2 + offset
            mends = [f"begin at {1.0005 * scale_px / last:.4g}"] if last > 0 else []
            mends += [f"search {rounded} labels"] if rounded <= _MOST_LABELS else []
            raise UsageError(
                f"range {near:g}:{far:g} needs {rounded} disparity labels, but {limit} are searched: {' or '.join(mends)}"
            )
        return cls(labels=rounded if labels is None else labels, offset_px=offset, scale_px=scale_px)

    @classmethod
    def reaching(cls, scale_px: float, far: float, labels: int) -> DisparityWindow:
        """Make the window of a number of labels from `far` (may be inf) to as near as they reach."""
        if not far > 0 or not 3 <= labels <= _MOST_LABELS:
            raise UsageError(f"{labels} labels from {far:g}: give a far end above 0 and 3 to {_MOST_LABELS} labels")
        return cls(labels=labels, offset_px=(scale_px / far if math.isfinite(far) else 0.0) - 1.0, scale_px=scale_px)

    @property
    def nearest(self) -> float:
        """Depth one pixel below the last label; NaN where the pair is not metric."""
        return self._at(self.labels - 2)

    @property
    def farthest(self) -> float:
        """Depth at disparity 1, inf for a window that reaches to infinity; NaN where the pair is not metric."""
        return self._at(1.0)

    def _at(self, disparity_px: float) -> float:
        if self.scale_px <= 0:
            return math.nan
        total = disparity_px + self.offset_px
        return self.scale_px / total if total > 1e-9 else math.inf

    def depth(self, disparity_px: NDArray[np.float32]) -> NDArray[np.float32]:
        """Turn disparities of any shape into depths along the rectified z axis; NaN stays NaN, beyond infinity is inf."""
        if self.scale_px <= 0:
            raise UsageError("this pair has no focal length and baseline, so it has no depth: give a calibration")
        total = np.asarray(disparity_px, np.float64) + self.offset_px
        with np.errstate(over="ignore"):  # a depth past float32 is as good as infinity
            depth = np.where(total > 0, self.scale_px / np.where(total > 0, total, 1.0), np.inf)
            return np.where(np.isnan(total), np.nan, depth).astype(np.float32)

    def depth_map(self, disparity_px: NDArray[np.float32]) -> NDArray[np.float32]:
        """Turn a whole disparity map (height, width) into depth, glass considered."""
        if self.glass is None or disparity_px.shape != (self.glass.height, self.glass.width):
            return self.depth(disparity_px)
        return self.depth(disparity_px + self.glass.missing_px(disparity_px))
