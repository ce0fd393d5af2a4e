"""Several threads that go through the same phases side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from threading import Barrier, BrokenBarrierError

__all__ = ["Crew", "Phase", "share"]

Phase = Callable[[int, int], None]


def share(total: int, worker: int, workers: int) -> tuple[int, int]:
    """Return begin and end of a worker's even part of `total` things."""
    return total * worker // workers, total * (worker + 1) // workers


class Crew:
    """So many workers, the caller among them; the threads wait between frames and end with the crew."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._threads = ThreadPoolExecutor(workers - 1, "matcher") if workers > 1 else None

    def run(self, phases: Sequence[Phase]) -> None:
        """Do each phase as `phase(worker, workers)` in all workers, and begin the next when all are done.

        What a phase raises is raised here, once nobody works any more.
        """
        if self._threads is None:
            for phase in phases:
                phase(0, 1)
            return
        together = Barrier(self.workers)

        def work(worker: int) -> None:
            try:
                for phase in phases:
                    phase(worker, self.workers)
                    together.wait()
            except BaseException:
                together.abort()
                raise

        others = [self._threads.submit(work, worker) for worker in range(1, self.workers)]
        try:
            with suppress(BrokenBarrierError):  # only the echo of what happened in another worker
                work(0)
        finally:
            failures = [other.exception() for other in others]
        for failure in failures:
            if failure is not None and not isinstance(failure, BrokenBarrierError):
                raise failure
