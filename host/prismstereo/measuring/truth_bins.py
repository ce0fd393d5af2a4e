"""Depth held against the truth, by distance; and whether it is off by what its disparity is off by.

To first order a disparity error e is worth depth^2 / scale * e. Where the depth error is another one, a scale, an offset or a
baseline is wrong, however good the matches are.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError

__all__ = ["INLIER_PX", "TruthBin", "TruthErrors", "truth_bins"]

Array = NDArray[np.float64]

INLIER_PX = 1.0
_BINS = 8
_FEWEST = 50  # pixels of a bin
_ONE_DISTANCE = 1.05  # farthest over nearest, up to which there is one bin
_ENDS = (0.5, 99.5)  # percentiles of the true depth: a bin needs no single far pixel


@dataclass(frozen=True, slots=True)
class TruthErrors:
    """Errors of the matches within a pixel of the truth. Biases are medians, signed, + is farther or more disparity.

    `predicted_rms_mm` is what `disparity_rms_px` is worth as depth.
    """

    disparity_bias_px: float
    disparity_rms_px: float
    depth_bias_percent: float
    depth_rms_mm: float
    depth_rms_percent: float
    predicted_rms_mm: float


@dataclass(frozen=True, slots=True)
class TruthBin:
    """What was found of the things between two true distances (mm), `pixels` of which the truth is known.

    `bad_percent`: of the matched pixels, those more than a pixel off. `errors`: of the others, None where there are none.
    """

    from_mm: float
    to_mm: float
    pixels: int
    fill_percent: float
    bad_percent: float
    errors: TruthErrors | None


def truth_bins(
    depth_mm: Array, true_mm: Array, scale_px: float, edges_mm: tuple[float, ...] | None = None
) -> tuple[TruthBin, ...]:
    """Compare depths (...) with true ones (...), NaN for unmatched and for unknown; nearest bin first.

    Bins are of equal ratio unless their edges are given; one with hardly a pixel is left out. `UsageError` without any truth.
    """
    known = np.isfinite(true_mm) & (true_mm > 0)
    if not known.any():
        raise UsageError("there is no pixel of which the true depth is known: nothing can be held against it")
    edges = np.array(edges_mm) if edges_mm else _edges(true_mm[known])
    return tuple(
        _bin(depth_mm[here], true_mm[here], scale_px, (float(low), float(high)))
        for low, high in pairwise(edges)
        if (here := known & (true_mm >= low) & (true_mm < high)).sum() >= _FEWEST
    )


def _edges(true_mm: Array) -> Array:
    near, far = np.percentile(true_mm, _ENDS)
    bins = _BINS if far > _ONE_DISTANCE * near else 1
    return np.asarray(np.geomspace(near * (1 - 1e-6), max(far, near * 1.01) * (1 + 1e-6), bins + 1))


def _bin(depth: Array, true: Array, scale_px: float, ends: tuple[float, float]) -> TruthBin:
    matched = np.isfinite(depth) & (depth > 0)
    d, z = depth[matched], true[matched]
    error = scale_px / d - scale_px / z
    good = np.abs(error) <= INLIER_PX
    bad = 100 * float(1 - good.mean()) if len(good) else 0.0
    found = _errors(d[good], z[good], error[good], scale_px) if good.any() else None
    return TruthBin(*ends, len(true), 100 * float(matched.mean()), bad, found)


def _errors(d: Array, z: Array, error: Array, scale_px: float) -> TruthErrors:
    rms_px = float(np.sqrt(np.mean(error**2)))
    return TruthErrors(
        disparity_bias_px=float(np.median(error)),
        disparity_rms_px=rms_px,
        depth_bias_percent=100 * float(np.median((d - z) / z)),
        depth_rms_mm=float(np.sqrt(np.mean((d - z) ** 2))),
        depth_rms_percent=100 * float(np.sqrt(np.mean(((d - z) / z) ** 2))),
        predicted_rms_mm=rms_px * float(np.sqrt(np.mean(z**4))) / scale_px,
    )
