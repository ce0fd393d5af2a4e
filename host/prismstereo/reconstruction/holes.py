"""Small holes of a surface, filled where their whole rim lies on one plane; large ones, and those at depth edges, stay open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.reconstruction.surface import Surface
from prismstereo_hw.errors import UsageError

__all__ = ["HOLE_PX", "fill_small_holes"]

Array = NDArray[np.float64]

HOLE_PX = 64
_FEWEST = 6  # pixels of a rim that show a plane and whether it is one
_SIGMAS = 2.0  # that a rim may be off its plane, root mean square
_UNSURE = 2.0  # times the rim's own noise: nobody saw what is filled in


@dataclass(frozen=True, slots=True)
class _Planes:
    """Per hole: disparity (N,) at its middle (N, 2), column and row, slopes (N, 2), rms off it (N,), which to trust."""

    value: Array
    middle: Array
    slopes: Array
    rms: Array
    good: NDArray[np.bool_]


def fill_small_holes(surface: Surface, most_px: int = HOLE_PX) -> Surface:
    """Fill holes of up to `most_px` pixels by the plane of their rim; what is filled is marked, and has twice its noise."""
    if most_px < 1:
        raise UsageError(f"holes of up to {most_px} pixels: give 1 or more, or leave holes open")
    known = surface.known
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~known).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= most_px
    small[0] = False
    height, width = known.shape
    left, top = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
    right, bottom = left + stats[:, cv2.CC_STAT_WIDTH], top + stats[:, cv2.CC_STAT_HEIGHT]
    small &= (left > 0) & (top > 0) & (right < width) & (bottom < height)  # what reaches the border has no whole rim
    if not small.any():
        return surface
    planes = _planes(surface, np.asarray(labels), count, small)
    rows, columns = np.nonzero(planes.good[labels])
    which = labels[rows, columns]
    offset = np.stack([columns, rows], axis=-1) - planes.middle[which]
    inverse, sigma, filled = surface.inverse_px.copy(), surface.sigma_px.copy(), surface.filled.copy()
    inverse[rows, columns] = planes.value[which] + np.sum(planes.slopes[which] * offset, axis=-1)
    sigma[rows, columns] = _UNSURE * planes.rms[which]
    filled[rows, columns] = True
    return replace(surface, inverse_px=inverse, sigma_px=sigma, filled=filled)


def _planes(surface: Surface, labels: NDArray[np.int32], count: int, small: NDArray[np.bool_]) -> _Planes:
    """Fit a plane to the rim of every small hole: the known pixels that touch it."""
    which, rows, columns = _rims(labels, small)
    values = surface.inverse_px[rows, columns].astype(np.float64)

    def total(weights: Array | None = None) -> Array:
        return np.bincount(which, weights=weights, minlength=count).astype(np.float64)

    n = np.maximum(total(), 1)
    middle = np.stack([total(columns.astype(float)), total(rows.astype(float))], axis=-1) / n[:, None]
    mean = total(values) / n
    x, y, v = columns - middle[which, 0], rows - middle[which, 1], values - mean[which]
    xx, xy, yy, xv, yv = total(x * x), total(x * y), total(y * y), total(x * v), total(y * v)
    determinant = xx * yy - xy * xy
    solvable = determinant > 1e-6 * np.maximum(xx * yy, 1)
    safe = np.where(solvable, determinant, 1)
    slopes = np.stack([(xv * yy - yv * xy) / safe, (yv * xx - xv * xy) / safe], axis=-1)
    off = v - slopes[which, 0] * x - slopes[which, 1] * y
    freedom = np.maximum(total() - 3, 1)
    noise = np.sqrt(total(surface.sigma_px[rows, columns].astype(np.float64) ** 2) / n)
    rms = np.sqrt(total(off**2) / freedom)
    good = small & solvable & (total() >= _FEWEST) & (rms <= _SIGMAS * noise)
    return _Planes(mean, middle, slopes, np.maximum(rms, noise), good)


def _rims(
    labels: NDArray[np.int32], small: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return which hole, row and column (N,) of the known pixels beside each small hole; one beside two is given to both."""
    width = labels.shape[1]
    found = []
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        rows, columns = np.nonzero(small[labels])
        beside = rows + dy, columns + dx
        rim = labels[beside] == 0
        found.append(
            labels[rows[rim], columns[rim]].astype(np.int64) * labels.size + (beside[0] * width + beside[1])[rim]
        )
    which, place = np.divmod(np.unique(np.concatenate(found)), labels.size)
    rows, columns = np.divmod(place, width)
    return which, rows, columns
