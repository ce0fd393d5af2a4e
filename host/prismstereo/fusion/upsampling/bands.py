"""Rows of a still in bands that are worked on at once; where the bands lie does not depend on how many work."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

__all__ = ["bands_of", "in_bands"]


def bands_of(rows: int, each: int) -> list[tuple[int, int]]:
    """Return the first and end rows of bands of `each` rows that make up `rows`."""
    return [(first, min(first + each, rows)) for first in range(0, rows, each)]


def in_bands(work: Callable[[int, int], object], bands: list[tuple[int, int]], threads: int) -> None:
    """Call `work(first, end)` for all bands, in so many threads; what one raises is raised here."""
    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(lambda band: work(*band), bands):
            pass
