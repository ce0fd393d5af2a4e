"""Matching at one resolution: planes, label lists, sweeps and check of one size of picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.tiles.census_kernels import EDGE, PLANES
from prismstereo_device.match.tiles.crew import share
from prismstereo_device.match.tiles.label_kernels import list_labels
from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.map_kernels import mark_flat
from prismstereo_device.match.tiles.path_kernels import LABEL_BYTES, ListArrays
from prismstereo_device.match.tiles.scratch import Desk, aligned
from prismstereo_device.match.tiles.sweep_kernels import sweep_columns, sweep_rows
from prismstereo_device.match.tiles.winner_kernels import check_rows
from prismstereo_device.reasons import Reason

__all__ = ["MARGINS", "Level", "Lists", "Penalties"]

MARGINS = np.array([2, TILE])  # rows and columns around a map, unmatched: windows need not look where they are
_BYTE_LABELS = 256
_MOST_ON_AVERAGE = 48  # labels in the lists of a row of tiles; ten are usual
_NEEDS = np.array(
    [2, 2, 4]
)  # coarse pixels around a tile that vote; votes of them, votes of every fourth pixel of a hint
Grey = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Penalties:
    """Prices in comparisons of the census, 0..31: of a step of one label, and of a jump between like and unlike greys."""

    step: int = 10
    jump: int = 60
    jump_at_edge: int = 20
    unique: float = 0.05

    def array(self) -> NDArray[np.int64]:
        """As the kernels take them."""
        return np.array([self.step, self.jump, self.jump_at_edge])


@dataclass(frozen=True, slots=True)
class Lists:
    """The labels of every tile, and where its sums lie in the volume."""

    labels: NDArray[np.int32]
    starts: NDArray[np.int64]
    counts: NDArray[np.int64]
    volumes: NDArray[np.int64]
    known: NDArray[np.uint8]
    most: int

    def arrays(self) -> ListArrays:
        """As the kernels take them."""
        return self.labels, self.starts, self.counts, self.volumes

    @classmethod
    def all_of(cls, tiles: int, count: int) -> Lists:
        """Return one list of all labels that every tile shares."""
        whole = np.full(tiles, count)
        places = np.arange(tiles) * count * LABEL_BYTES
        return cls(np.arange(count, dtype=np.int32), 0 * places, whole, places, np.ones(tiles, np.uint8), count)

    @classmethod
    def empty(cls, tiles: int, most: int) -> Lists:
        """Return lists that hold up to `most` labels each."""
        starts = np.arange(tiles) * most
        return cls(np.zeros(tiles * most, np.int32), starts, 0 * starts, 0 * starts, np.zeros(tiles, np.uint8), most)


class Level:
    """One resolution of a pair: pictures of `height` x `width` pixels and `count` labels."""

    def __init__(self, height: int, width: int, count: int, lists: int | None, workers: int) -> None:
        """Make the memory; `lists`: the most labels of a tile's own list, None for all labels in every tile."""
        self.height, self.width, self.count = height, width, count
        self.down, self.across = -(-height // TILE), -(-width // TILE)
        rows, columns = self.down * TILE, self.across * TILE
        self.offset = -(-count // TILE) * TILE
        wide = columns + self.offset
        self.padded = tuple(np.zeros((rows + 2 * EDGE, columns + 2 * EDGE), np.uint8) for _ in range(2))
        self._upright = _planes((rows, PLANES, columns), 0), _planes((rows, PLANES, wide), 5)
        self._lying = [(_planes((columns, PLANES, TILE), 0), _planes((wide, PLANES, TILE), 5)) for _ in range(workers)]
        self._grey = [np.zeros((columns, TILE), np.uint8) for _ in range(workers)]
        tiles = self.down * self.across
        self.all_labels = lists is None
        self.lists = Lists.all_of(tiles, count) if lists is None else Lists.empty(tiles, lists)
        dtype = np.uint8 if count <= _BYTE_LABELS else np.uint16
        self.disparity = np.full((rows + 2 * MARGINS[0], columns + 2 * MARGINS[1]), -int(Reason.UNMATCHED), np.int16)
        self.winner, self.margin = np.zeros((rows, columns), dtype), np.zeros((rows, columns), np.uint8)
        parts = [share(self.across, worker, workers) for worker in range(workers)]
        self._firsts = np.array([begin * TILE for begin, _ in parts])
        self._widths = np.array([(end - begin) * TILE + self.offset for begin, end in parts])
        self._places = np.concatenate([[0], np.cumsum(self._widths * rows)])
        self._right_cost, self._right_label = np.zeros(self._places[-1], np.uint8), np.zeros(self._places[-1], dtype)

    @property
    def volume_bytes(self) -> int:
        """The bytes of the volume: of all labels, or of as many as tiles have on average at the very most."""
        labels = self.count if self.all_labels else min(self.lists.most, _MOST_ON_AVERAGE)
        return self.down * self.across * labels * LABEL_BYTES

    def fill(self, side: int, picture: Grey, shift: int) -> None:
        """Take the left (0) or right (1) picture, moved right by `shift`; its border goes on outside."""
        padded = self.padded[side]
        shift = min(shift, self.width)
        shown = picture[:, : max(self.width - shift, 1)]
        below, beyond = padded.shape[0] - EDGE - picture.shape[0], padded.shape[1] - EDGE - shift - shown.shape[1]
        cv2.copyMakeBorder(shown, EDGE, below, EDGE + shift, beyond, cv2.BORDER_REPLICATE, dst=padded)

    def list_from(
        self, coarse: Level, hint: NDArray[np.float32], first: int, row_bytes: int, worker: int, workers: int
    ) -> None:
        """List the labels of a worker's tile rows by the map of the level below."""
        scale = np.array([-(-self.height // coarse.height), -(-self.width // coarse.width)])
        size = np.array([coarse.height, coarse.width])
        list_labels(
            coarse.disparity, coarse.winner, MARGINS, scale, size, hint, first, _NEEDS, row_bytes, self.across,
            self.lists.arrays(), self.lists.known, self.count, self.lists.most, *share(self.down, worker, workers),
        )  # fmt: skip

    def sweep_rows(self, volume: Grey, desk: Desk, prices: Penalties, worker: int, workers: int) -> None:
        """Look at a worker's tile rows, and sum their costs along rows."""
        sweep_rows(
            self.padded, self._upright, self._lying[worker], self._grey[worker], self.lists.arrays(), prices.array(), desk.walk,
            volume, self.width, *share(self.down, worker, workers),
        )  # fmt: skip

    def sweep_columns(self, volume: Grey, desk: Desk, prices: Penalties, worker: int, workers: int) -> None:
        """Sum the costs of a worker's tile columns along columns, and decide its pixels."""
        right = self._right_cost, self._right_label, int(self._places[worker])
        maps = self.disparity, self.winner, self.margin, MARGINS
        sweep_columns(
            self.padded[0], self._upright, self.lists.arrays(), self.lists.known, prices.array(), desk.walk, desk.tile_sums,
            volume, right, maps, self.width, self.height, round(prices.unique * 256), *share(self.across, worker, workers),
        )  # fmt: skip

    def check(self, worker: int, workers: int) -> None:
        """Drop what the right picture sees differently, and what shows nothing at all, in a worker's tile rows."""
        lists, part = self.lists, share(self.down, worker, workers)
        check_rows(
            self._right_cost, self._right_label, self._places[:-1], self._firsts, self._widths, lists.labels, lists.starts,
            lists.counts, self.winner, self.disparity, MARGINS, self.offset, self.height, *part,
        )  # fmt: skip
        mark_flat(self.padded[0], self.disparity, MARGINS, EDGE, self.height, *part)


def _planes(shape: Sequence[int], skew: int) -> Grey:
    return aligned(int(np.prod(shape)), skew).reshape(shape)
