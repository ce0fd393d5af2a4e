"""Working memory of the sweeps: one volume for all workers, and a set of small buffers for each.

Levels share it, coarse and fine, so that the working set stays in the cache. Pages that are never written cost no memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.path_kernels import HELD_BYTES, LABEL_BYTES, LINK_BYTES, buffer_bytes

__all__ = ["Desk", "aligned"]

_LINE = 64


def aligned(size: int, skew: int = 0) -> NDArray[np.uint8]:
    """Return `size` bytes, zero, at a cache line's begin plus `skew` lines: parallel streams keep out of each other's sets."""
    whole = np.zeros(size + _LINE * (skew + 1), np.uint8)
    begin = -whole.ctypes.data % _LINE + _LINE * skew
    return whole[begin : begin + size]


_ROOM = 1 << 23  # bytes of costs and sums of a walk; beyond, walking twice is cheaper than memory


class Desk:
    """What one worker needs for paths of at most `longest` tiles and `most` labels."""

    def __init__(self, longest: int, most: int) -> None:
        tile = most * TILE * HELD_BYTES
        room = min(max(_ROOM, tile), longest * tile)
        self.walk = (
            np.zeros(3 * most, np.int32),  # links across tiles
            np.zeros(LINK_BYTES * most, np.uint8),  # links inside a tile
            aligned(2 * buffer_bytes(most), 4),  # paths there
            aligned(TILE),
            aligned(2 * buffer_bytes(most), 4),  # paths back
            aligned(TILE),
            aligned(room, 8),  # costs and sums of the way there
            np.zeros((longest + 1) * (most + 1) * TILE, np.uint8),  # states kept
            np.zeros(longest + 1, np.int64),  # first tile of each stage
        )
        self.tile_sums = aligned(most * LABEL_BYTES, 8), aligned(most * LABEL_BYTES)
