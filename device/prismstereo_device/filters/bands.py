"""Bands of rows, worked on at once. Every row is worked out alone, so the result does not depend on how many there are."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

__all__ = ["in_bands"]

_LEAST_ROWS = 64  # a smaller band costs more in starting its thread than it saves


def in_bands(work: Callable[[int, int], None], height: int, threads: int) -> None:
    """Call `work(first, end)` for bands that make up rows 0 .. height - 1, in so many threads."""
    bands = max(1, min(threads, height // _LEAST_ROWS))
    borders = [height * number // bands for number in range(bands + 1)]
    if bands == 1:
        work(0, height)
        return
    with ThreadPoolExecutor(bands - 1) as pool:
        others = [pool.submit(work, borders[k], borders[k + 1]) for k in range(1, bands)]
        work(borders[0], borders[1])
        for other in others:
            other.result()
