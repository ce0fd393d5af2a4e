"""What the two matchers of this folder share: the memory for one size of pair, kept from frame to frame."""

from __future__ import annotations

from abc import abstractmethod
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.base import Found, Grey, Matcher, Search
from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.level import Level, Penalties
from prismstereo_device.match.tiles.path_kernels import LABEL_BYTES
from prismstereo_device.match.tiles.pyramid import LARGEST_VOLUME, NO_HINT, Pyramid, Refine

__all__ = ["SweepMatcher", "dense_bytes"]

_AS_USUAL = MatchSettings()
_PRICES = Penalties()


def dense_bytes(height: int, width: int, count: int) -> int:
    """Return the bytes of a volume of all labels."""
    return -(-height // TILE) * -(-width // TILE) * count * LABEL_BYTES


class SweepMatcher(Matcher):
    """Semi-global matching by sweeps over tiles; a subclass says with which levels.

    `refine(left, right, steps, threads)` finds the fractions of a map of sixteenths (int16, negative: unmatched, kept so)
    before the mean of 5x5 pixels. The result does not depend on threads, nor on the processor. One search at a time: a
    second one from another thread waits.
    """

    def __init__(
        self, settings: MatchSettings = _AS_USUAL, *, prices: Penalties = _PRICES, refine: Refine | None = None
    ) -> None:
        super().__init__(settings)
        self._prices, self._refine = prices, refine
        self._lock = Lock()
        self._kept: tuple[tuple[int, ...], Pyramid] | None = None

    @abstractmethod
    def levels(self, height: int, width: int, count: int, workers: int) -> list[Level]:
        """Return the levels for pictures of this size and so many labels, coarsest first."""

    def rows_at_once(self, height: int, width: int, count: int) -> int:
        """Return how many rows of a picture are matched at once, so that memory suffices; all of them as a rule."""
        del width, count
        return height

    def search(self, left: Grey, right: Grey, search: Search) -> Found:
        """Search grey pictures (height, width): disparity, confidence (lead of the match over its best rival) and reasons."""
        height, width = left.shape
        rows = self.rows_at_once(height, width, search.labels - search.first)
        with self._lock:
            if rows >= height:
                return self._search(left, right, search)
            parts = [self._band(left, right, search, begin, rows) for begin in range(0, height, rows)]
        disparity, confidence, reasons = (np.concatenate(maps) for maps in zip(*parts, strict=True))
        return Found(disparity, confidence, reasons)

    def _band(self, left: Grey, right: Grey, search: Search, begin: int, rows: int) -> tuple[NDArray[np.generic], ...]:
        """Search `rows` rows from `begin` on, and a tile beyond to either side."""
        first, end = max(begin - TILE, 0), min(begin + rows + TILE, left.shape[0])
        wide = slice(first, end)
        hint = None if search.hint is None else search.hint[wide]
        part = Search(search.labels, search.first, search.threads, hint)
        found = self._search(left[wide], right[wide], part)
        inner = slice(begin - first, min(begin + rows, left.shape[0]) - first)
        assert found.confidence is not None
        assert found.reasons is not None
        return found.disparity_px[inner], found.confidence[inner], found.reasons[inner]

    def _search(self, left: Grey, right: Grey, search: Search) -> Found:
        height, width = left.shape
        pyramid = self._pyramid(height, width, search.labels - search.first, search.threads)
        hint = NO_HINT if search.hint is None else np.require(search.hint, np.float32, ["C", "W"])
        pyramid.steps(left, right, search.first, hint)
        if self._refine is not None:
            pyramid.refine(left, right, search.first, self._refine)
        return Found(*pyramid.finish(search.first))

    def _pyramid(self, height: int, width: int, count: int, threads: int) -> Pyramid:
        key = height, width, count, threads
        if self._kept is None or self._kept[0] != key:
            self._kept = None  # let go of the old memory before there is new
            workers = max(1, min(threads, -(-width // TILE)))
            self._kept = key, Pyramid(self.levels(height, width, count, workers), workers, self._prices)
        return self._kept[1]


def dense_rows(width: int, count: int) -> int:
    """Return the rows of tiles, in pixels, whose volume of all labels is as large as it may be; a tile at least."""
    return max(LARGEST_VOLUME // dense_bytes(TILE, width, count), 1) * TILE
