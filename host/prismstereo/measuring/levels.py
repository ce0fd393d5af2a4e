"""Which whole disparities a scene uses: how finely its depths are told apart before any fraction of a pixel."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_SHARE", "Levels", "levels"]

LEAST_SHARE = 1e-4  # of the matched pixels, that a level is in use for: single wrong matches are none


@dataclass(frozen=True, slots=True)
class Levels:
    """Pixels by whole disparity: `counts[i]` of those that round to `first + i` px; and how many levels are in use."""

    first: int
    counts: tuple[int, ...]
    in_use: int

    @property
    def span(self) -> int:
        """From the first level in use to the last, both included."""
        least = LEAST_SHARE * sum(self.counts)
        used = [index for index, count in enumerate(self.counts) if count and count >= least]
        return used[-1] - used[0] + 1 if used else 0


def levels(maps: Iterable[NDArray[np.floating]]) -> Levels:
    """Count the whole disparities of maps (height, width) in px, NaN where unmatched; all of them together."""
    counts = np.zeros(0, np.int64)
    for one in maps:
        whole = np.rint(np.maximum(one[np.isfinite(one)], 0)).astype(np.int64)
        own = np.bincount(whole, minlength=len(counts))
        own[: len(counts)] += counts
        counts = own
    if not counts.any():
        return Levels(0, (), 0)
    first = int(np.flatnonzero(counts)[0])
    used = counts >= max(LEAST_SHARE * counts.sum(), 1)
    return Levels(first, tuple(counts[first:].tolist()), int(used.sum()))
