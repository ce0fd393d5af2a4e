"""What neighbouring pixels share of their noise, and what that means for a fit.

A map of a hundred thousand pixels is no hundred thousand measurements: a matcher's windows overlap, and a fraction of a pixel
that leans does so all over a surface. The covariance of a fit is therefore read from how its residuals add up in blocks of the
patch (a sandwich with clusters, after Liang and Zeger); where there are too few blocks, each 7x7 pixels count as one. What a
whole patch shares leaves no residual at all: it comes on top, in the pattern that harms the most, so a radius is rather
better than it says.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.measuring.fix import LEAN_PX, ROUNDING_PX

__all__ = ["MOST_PIXELS", "covariance"]

Array = NDArray[np.float64]

MOST_PIXELS = 40_000  # that a fit is made of: more of them share their noise with these
_BLOCKS, _LEAST_BLOCK_PX = 8, 12
_FEWEST_BLOCKS = 12
_SHARED_PIXELS = 49


def covariance(J: Array, residuals: Array, columns: Array, rows: Array, pixels: int) -> Array:
    """Return the covariance (P, P) of the parameters of a least-squares fit with derivatives J (N, P) and residuals (N,) px.

    `pixels` is how many there were before they were thinned. It is the larger one of two, that of the blocks and that of
    pixels of which `_SHARED_PIXELS` count as one, and what leans.
    """
    inverse = np.asarray(np.linalg.pinv(J.T @ J), np.float64)
    noise = max(float(np.mean(residuals**2)), ROUNDING_PX**2)
    spread = inverse * noise * max(_SHARED_PIXELS * len(J) / pixels, 1.0)
    blocks = _of_blocks(inverse, J, residuals, columns, rows)
    if blocks is not None and np.sum(blocks * (J.T @ J)) > np.sum(spread * (J.T @ J)):
        spread = blocks
    return np.asarray(spread + LEAN_PX**2 * len(J) * inverse)


def _of_blocks(inverse: Array, J: Array, residuals: Array, columns: Array, rows: Array) -> Array | None:
    """Return the sandwich with blocks as clusters; None where there are too few of them."""
    size = max(np.ptp(columns) / _BLOCKS, np.ptp(rows) / _BLOCKS, _LEAST_BLOCK_PX)
    names = (columns // size).astype(np.int64) * 1_000_000 + (rows // size).astype(np.int64)
    _, which = np.unique(names, return_inverse=True)
    count = int(which.max()) + 1
    if count < _FEWEST_BLOCKS:
        return None
    sums = np.stack([np.bincount(which, weights=residuals * column, minlength=count) for column in J.T], axis=-1)
    return np.asarray(inverse @ (sums.T @ sums) @ inverse * count / (count - J.shape[1]))
