"""From a pair to a map: levels from coarse to fine, and what is done to the finest map."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import FRACTION
from prismstereo_device.match.tiles.census_kernels import EDGE
from prismstereo_device.match.tiles.crew import Crew, Phase, share
from prismstereo_device.match.tiles.level import MARGINS, Level, Penalties
from prismstereo_device.match.tiles.map_kernels import smooth, unpack
from prismstereo_device.match.tiles.scratch import Desk, aligned
from prismstereo_device.match.tiles.speckle_kernels import clear_small, find_runs, join_rows
from prismstereo_device.reasons import Reason

__all__ = ["LARGEST_VOLUME", "NO_HINT", "Pyramid", "Refine"]

Grey = NDArray[np.uint8]
Refine = Callable[[Grey, Grey, NDArray[np.int16], int], NDArray[np.int16]]
NO_HINT = np.empty((0, 0), np.float32)
_SMALLEST_ISLAND = 100  # pixels
LARGEST_VOLUME = 1 << 30  # bytes; lists that need more lose their rarest labels. Only what is written costs memory


class Pyramid:
    """The levels of one size of pair, coarsest first, with all the memory they need."""

    def __init__(self, levels: list[Level], workers: int, prices: Penalties) -> None:
        self.levels, self._prices = levels, prices
        self.crew = Crew(workers)
        self.finest = levels[-1]
        self._volume = aligned(max(min(level.volume_bytes, LARGEST_VOLUME) for level in levels), 20)
        most = max(level.lists.most for level in levels)
        self._desks = [Desk(max(self.finest.down, self.finest.across), most) for _ in range(workers)]
        height, width = self.finest.height, self.finest.width
        self._smooth = self.finest.disparity.copy()
        self._islands = [np.zeros(height * width + 1, np.int32) for _ in range(4)]
        self._rows = np.zeros(2 * (height + 1), np.int32)

    def steps(self, left: Grey, right: Grey, first: int, hint: NDArray[np.float32]) -> None:
        """Fill the finest level's map."""
        phases: list[Phase] = [partial(self._fill, left, right, first)]
        for coarse, level in zip([None, *self.levels[:-1]], self.levels, strict=True):
            phases += [
                partial(self._rows_of, level, coarse, hint, first),
                partial(self._columns_of, level),
                level.check,
            ]
        self.crew.run(phases)

    @property
    def _inner(self) -> tuple[slice, slice]:
        top, left = MARGINS
        return slice(top, top + self.finest.height), slice(left, left + self.finest.width)

    def refine(self, left: Grey, right: Grey, first: int, refine: Refine) -> None:
        """Let `refine` find the fractions of the map, before the symmetric mean."""
        steps = self.finest.disparity[self._inner].copy()
        steps[steps >= 0] += np.int16(first * FRACTION)
        steps = refine(left, right, steps, self.crew.workers)
        self.finest.disparity[self._inner] = np.where(
            steps >= 0, np.maximum(steps - np.int16(first * FRACTION), 0), steps
        )

    def finish(self, first: int) -> tuple[NDArray[np.float32], Grey, Grey]:
        """Smooth the map, take small islands away, and return disparity, confidence and reasons."""
        size = (self.finest.height, self.finest.width)
        found = np.empty(size, np.float32), np.empty(size, np.uint8), np.empty(size, np.uint8)
        self.crew.run([self._runs, self._seams, partial(self._clear, first, found)])
        return found

    def _fill(self, left: Grey, right: Grey, first: int, worker: int, workers: int) -> None:
        for side, picture, shift in ((0, left, 0), (1, right, first)):
            if worker != side * (workers - 1):
                continue
            self.finest.fill(side, picture, shift)
            fine = self.finest
            for level in reversed(self.levels[:-1]):
                whole = fine.padded[side][EDGE:-EDGE, EDGE:-EDGE]
                scale = -(-fine.height // level.height), -(-fine.width // level.width)
                small = whole.shape[1] // scale[1], whole.shape[0] // scale[0]
                reduced = cv2.resize(whole, small, interpolation=cv2.INTER_AREA)
                level.fill(side, np.asarray(reduced, np.uint8)[: level.height, : level.width], 0)
                fine = level

    def _rows_of(
        self, level: Level, coarse: Level | None, hint: NDArray[np.float32], first: int, worker: int, workers: int
    ) -> None:
        if coarse is not None and not level.all_labels:
            before = hint if level is self.finest else NO_HINT
            level.list_from(coarse, before, first, self._volume.size // level.down, worker, workers)
        level.sweep_rows(self._volume, self._desks[worker], self._prices, worker, workers)

    def _columns_of(self, level: Level, worker: int, workers: int) -> None:
        level.sweep_columns(self._volume, self._desks[worker], self._prices, worker, workers)

    def _runs(self, worker: int, workers: int) -> None:
        fine = self.finest
        begin, end = share(fine.height, worker, workers)
        smooth(fine.disparity, self._smooth, MARGINS, fine.width, begin, end)
        find_runs(self._smooth, MARGINS, fine.width, begin, end, begin * fine.width, *self._islands, self._rows)

    def _seams(self, worker: int, workers: int) -> None:
        if worker:
            return
        fine, rows = self.finest, self._rows
        later = rows.size // 2
        for other in range(1, workers):
            y = share(fine.height, other, workers)[0]
            if 0 < y < fine.height:
                join_rows(
                    self._smooth, MARGINS, y, rows[y - 1], rows[later + y - 1], rows[y], rows[later + y], *self._islands
                )  # fmt: skip

    def _clear(self, first: int, found: tuple[NDArray[np.float32], Grey, Grey], worker: int, workers: int) -> None:
        part = share(self.finest.height, worker, workers)
        filtered = -int(Reason.FILTERED)
        clear_small(self._smooth, MARGINS, *part, *self._islands, self._rows, _SMALLEST_ISLAND, filtered)
        unpack(self._smooth, MARGINS, self.finest.margin, first, *found, *part)
