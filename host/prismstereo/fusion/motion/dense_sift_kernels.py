"""Compiled loops of dense SIFT: orientation cells, descriptors, and the least distance to a neighbouring descriptor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.compiled import compiled, inlined

__all__ = ["least_distances", "orientation_cells", "unit_descriptors"]

Float = NDArray[np.float32]


@inlined
def turn_and_size(gx: np.float32, gy: np.float32) -> tuple[np.float32, np.float32]:
    """Return the direction of a gradient in octants, 0 .. 8, and its length.

    Within an octant that is t (1 + 0.3476 (1 - t)), t the smaller over the larger component: 0.005 of an octant off the arc
    tangent at most.
    """
    ax, ay = abs(gx), abs(gy)
    large, small = max(ax, ay), min(ax, ay)
    t = small / max(large, np.float32(1e-9))
    turn = t * (np.float32(1.0) + np.float32(0.3476) * (np.float32(1.0) - t))
    if ay > ax:
        turn = np.float32(2.0) - turn
    if gx < 0:
        turn = np.float32(4.0) - turn
    if gy < 0:
        turn = np.float32(8.0) - turn
    return turn, large * np.sqrt(np.float32(1.0) + t * t)


@compiled
def orientation_cells(grey: Float, first: int, last: int, cells: Float) -> None:
    """Add the gradients of rows `first` to `last` - 1 of `grey` (h, w) to `cells` (gh, gw, 8), which start at zero.

    Cell (i, j) is centred on pixel (4 j + 1.5, 4 i + 1.5); a gradient goes to the two nearest of eight orientations, and to the
    four nearest cells with bilinear shares: the triangular window of half width 4.
    """
    height, width = grey.shape
    rows, columns = cells.shape[0], cells.shape[1]
    line = np.zeros((columns + 2, 8), np.float32)
    for y in range(max(first, 1), min(last, height - 1)):
        line[:] = np.float32(0.0)
        for x in range(1, width - 1):
            gx = np.float32(0.5) * (grey[y, x + 1] - grey[y, x - 1])
            gy = np.float32(0.5) * (grey[y + 1, x] - grey[y - 1, x])
            turn, size = turn_and_size(gx, gy)
            low = int(turn)
            part = (turn - np.float32(low)) * size
            size -= part
            low &= 7
            high = (low + 1) & 7
            place = (np.float32(x) - np.float32(1.5)) * np.float32(0.25) + np.float32(1.0)
            j = int(place)
            right = place - np.float32(j)
            left = np.float32(1.0) - right
            line[j, low] += left * size
            line[j, high] += left * part
            line[j + 1, low] += right * size
            line[j + 1, high] += right * part
        place = (np.float32(y) - np.float32(1.5)) * np.float32(0.25) + np.float32(1.0)
        above = int(place)
        share = place - np.float32(above)
        for i, weight in ((above - 1, np.float32(1.0) - share), (above, share)):
            if 0 <= i < rows:
                for j in range(columns):
                    for o in range(8):
                        cells[i, j, o] += weight * line[j + 1, o]


@compiled
def unit_descriptors(cells: Float, clip: float, descriptors: Float, texture: Float) -> None:
    """Write the descriptor of every 4 x 4 cells to `descriptors` (gh - 3, gw - 3, 128): unit length, clipped, unit length.

    `texture` (gh - 3, gw - 3) gets the length before. A descriptor of a place without any gradient is zero.
    """
    for i in range(descriptors.shape[0]):
        for j in range(descriptors.shape[1]):
            found = descriptors[i, j]
            total = np.float32(0.0)
            for a in range(4):
                for b in range(4):
                    for o in range(8):
                        value = cells[i + a, j + b, o]
                        found[(a * 4 + b) * 8 + o] = value
                        total += value * value
            length = np.sqrt(total)
            texture[i, j] = length
            if length <= np.float32(1e-6):
                found[:] = np.float32(0.0)
                continue
            limit = np.float32(clip) * length
            total = np.float32(0.0)
            for k in range(128):
                value = min(found[k], limit)
                found[k] = value
                total += value * value
            scale = np.float32(1.0) / np.sqrt(total)
            for k in range(128):
                found[k] *= scale


@compiled
def least_distances(ours: Float, theirs: Float, reach: int, distances: Float) -> None:
    """Write to `distances` (n, m) how far each unit descriptor of `ours` (n, m, 128) is from the nearest of `theirs`.

    Looked at are those up to `reach` steps away in rows and columns. Two empty places are 0 apart, an empty one and another 1.
    """
    rows, columns = distances.shape
    for i in range(rows):
        for j in range(columns):
            best = np.float32(-1.0)
            own = ours[i, j]
            for a in range(max(0, i - reach), min(rows, i + reach + 1)):
                for b in range(max(0, j - reach), min(columns, j + reach + 1)):
                    other = theirs[a, b]
                    alike = np.float32(0.0)
                    for k in range(128):
                        alike += own[k] * other[k]
                    best = max(best, alike)
            distances[i, j] = np.sqrt(max(np.float32(0.0), np.float32(2.0) - np.float32(2.0) * best))
