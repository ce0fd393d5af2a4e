"""One line of the benchmark table, and how two things are timed fairly against each other."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["BenchRow", "interleave"]


@dataclass(frozen=True, slots=True)
class BenchRow:
    """What was timed, in milliseconds of wall time (medians), against which named peer."""

    name: str
    ours_ms: float
    peer: str
    peer_ms: float
    note: str = ""

    @property
    def ratio(self) -> float:
        """How many times faster ours is than the peer."""
        return self.peer_ms / self.ours_ms


def interleave(ours: Callable[[], object], peer: Callable[[], object], rounds: int = 9) -> tuple[float, float]:
    """Time both in turn, A B A B ..., after one warm-up each; return the two medians in milliseconds."""
    ours(), peer()
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for kept, job in zip(times, (ours, peer), strict=True):
            begin = time.perf_counter()
            job()
            kept.append((time.perf_counter() - begin) * 1e3)
    return statistics.median(times[0]), statistics.median(times[1])
