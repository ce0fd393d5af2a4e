"""Growing Correspondence Seeds behind the matcher interface.

Cech and Sara, "Efficient sampling of disparity space for fast and accurate matching" (BenCOS 2007). Growing is one queue for
the whole picture and runs on one thread; the final matching takes rows apart and shares them out, with the same result.
"""

from __future__ import annotations

import logging
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from threading import Thread

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.base import Found, Grey, Matcher, Search
from prismstereo_device.match.growing.growing_kernels import FRACTION, MARGIN_PX, NEVER, ONE, grow, refined
from prismstereo_device.match.growing.seeds import Seeds, harris_seeds, map_seeds, random_seeds
from prismstereo_device.match.growing.selection_kernels import BEHIND, CHOSEN, LOST, ROW_SHIFT, listed, selected
from prismstereo_device.match.growing.settings import GrowingSettings
from prismstereo_device.match.growing.windows import PaddedPair, Windows
from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.reasons import Reason
from prismstereo_hw.errors import UsageError

__all__ = ["GrowingMatcher", "warm_up"]

Maps = tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]  # disparity, confidence, reasons

logger = logging.getLogger(__name__)

_HALF_PX = 2  # windows of 5x5
_MOST_PIXELS = 1 << 23  # larger pictures go strip by strip: growing takes about 100 bytes a pixel
_OVERLAP_PX = 16  # rows that a strip grows beyond its own on either side
_AS_USUAL, _AS_PUBLISHED = MatchSettings(), GrowingSettings()


class GrowingMatcher(Matcher):
    """Grows seeds best first, and keeps the confidently stable matches. A last map as hint adds seeds."""

    def __init__(self, settings: MatchSettings = _AS_USUAL, growing: GrowingSettings = _AS_PUBLISHED) -> None:
        super().__init__(settings)
        self.growing = growing

    def search(self, left: Grey, right: Grey, search: Search) -> Found:
        """Search grey pictures (height, width); confidence is the margin of the correlation over the next peak's."""
        height, width = left.shape
        rows = max(1, _MOST_PIXELS // width)
        parts: list[Maps] = []
        for top in range(0, height, rows):
            above, below = max(0, top - _OVERLAP_PX), min(height, top + rows + _OVERLAP_PX)
            hint = None if search.hint is None else search.hint[above:below]
            pair = PaddedPair.of(left[above:below], right[above:below])
            found = self._grown(pair, self._seeds(left[above:below], pair, replace(search, hint=hint)), search)
            own = slice(top - above, min(top + rows, height) - above)
            parts.append((found[0][own], found[1][own], found[2][own]))
        return Found(*(np.concatenate(strips) for strips in zip(*parts, strict=True)))

    def search_from(self, left: Grey, right: Grey, search: Search, seeds: Seeds) -> Found:
        """Search grey pictures (height, width) from seeds of one's own: rows, columns, disparities (n, 3) int64.

        `UsageError` for a seed outside of the pictures or of the search.
        """
        rows, columns, disparities = np.asarray(seeds, np.int64).reshape(-1, 3).T
        inside = (rows >= 0) & (rows < left.shape[0]) & (columns < left.shape[1]) & (columns >= disparities)
        inside &= (disparities >= search.first) & (disparities < search.labels)
        if not inside.all():
            worst = tuple(int(value[~inside][0]) for value in (rows, columns, disparities))
            raise UsageError(
                f"seed {worst} (row, column, disparity) lies outside of the pictures of {left.shape[1]}x{left.shape[0]} or of "
                f"the search {search.first} to {search.labels - 1}: leave it out"
            )
        return Found(*self._grown(PaddedPair.of(left, right), np.column_stack([rows, columns, disparities]), search))

    def _seeds(self, left: Grey, pair: PaddedPair, search: Search) -> Seeds:
        if self.growing.seeds == "random":
            seeds = random_seeds((left.shape[0], left.shape[1]), search.first, search.labels, self.growing)
        else:
            seeds = harris_seeds(left, pair, search.first, search.labels, self.growing)
        if search.hint is None:
            return seeds
        return np.concatenate([map_seeds(search.hint, search.first, search.labels), seeds])

    def _grown(self, pair: PaddedPair, seeds: Seeds, search: Search) -> Maps:
        """Grow seeds, match, refine: disparity, confidence and reasons (height, width) without the margin."""
        growing, windows = self.growing, pair.windows(_HALF_PX, self.growing.noise_grey)
        places = (seeds[:, 0] + MARGIN_PX) * pair.width + seeds[:, 1] + MARGIN_PX
        given = (pair.pictures, windows.sums, windows.powers, windows.floor, pair.width, search.first, search.labels)
        table, count = grow(
            *given,
            np.ascontiguousarray(np.column_stack([places, seeds[:, 2]])),
            NEVER + 1 if growing.tau == -math.inf else round(growing.tau * ONE),
            round(growing.mu * ONE),
            growing.max_hypotheses,
            growing.dgrow0,
            round(growing.epsilon * ONE),
        )
        chosen, margin, standing = self._matched(np.sort(listed(table, count, pair.width)), pair, search.threads)
        steps = pair.inner(refined(*given, chosen.ravel()))
        disparity = np.where(steps < 0, np.float32(np.nan), steps.astype(np.float32) / np.float32(FRACTION))
        margin = pair.inner(margin)
        confidence = np.where(steps < 0, 0, np.clip(margin.astype(np.int32) * 255 // ONE, 1, 255)).astype(np.uint8)
        return disparity, confidence, self._reasons(pair.inner(standing), pair.inner(windows.powers[0]), windows)

    def _matched(
        self, keys: NDArray[np.int64], pair: PaddedPair, threads: int
    ) -> tuple[NDArray[np.int16], NDArray[np.int16], NDArray[np.uint8]]:
        """Select among the sorted hypotheses of all rows: chosen disparity, margin and standing, (height, width) each."""
        shape = (pair.height, pair.width)
        maps = (np.empty(shape, np.int16), np.empty(shape, np.int16), np.empty(shape, np.uint8))
        starts = np.searchsorted(keys, np.arange(pair.height + 1, dtype=np.int64) << ROW_SHIFT)
        settings = np.array([round(self.growing.beta * ONE), self.growing.zonegap, self.growing.ordering], np.int32)
        ends = np.linspace(0, pair.height, min(threads, pair.height) + 1).astype(int)

        def select(block: tuple[int, int]) -> None:
            rows = slice(*block)
            selected(keys, starts[rows.start : rows.stop + 1], settings, maps[0][rows], maps[1][rows], maps[2][rows])

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(select, pairwise(ends)))
        return maps

    def _reasons(self, standing: NDArray[np.uint8], power: NDArray[np.int32], windows: Windows) -> NDArray[np.uint8]:
        """Say why a pixel is unmatched; a window is too weak where even its own picture would not correlate by tau."""
        names = np.full(4, Reason.UNMATCHED, np.uint8)
        names[[CHOSEN, BEHIND, LOST]] = Reason.MATCHED, Reason.OCCLUDED, Reason.AMBIGUOUS
        reasons = names[standing]
        weak = 2.0 * power < max(self.growing.tau, 0.0) * (2.0 * power + windows.floor)
        reasons[weak & (standing != CHOSEN)] = Reason.WEAK_TEXTURE
        return reasons


def warm_up() -> Thread:
    """Start to compile the loops in the background, or to load them from the cache; the thread ends when they are ready."""
    logger.info("the growing matcher is being compiled in the background: its first map may take some seconds longer")
    thread = Thread(target=_tried, name="warm-up of the growing matcher", daemon=True)
    thread.start()
    return thread


def _tried() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (24, 48), np.uint8)
    GrowingMatcher().search(picture, picture, Search(labels=8, threads=1))
