"""Work beside the frames, one piece after the other: compressing stills, looking at the optics, writing to slow disks."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

__all__ = ["Chores"]

logger = logging.getLogger(__name__)


class Chores(ThreadPoolExecutor):
    """One thread for chores. One that fails is in the log, though nobody asks for its result."""

    def __init__(self) -> None:
        super().__init__(1, "prismstereo-chores")

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let a chore be done after those that wait."""
        chore = super().submit(fn, *args, **kwargs)
        chore.add_done_callback(_report)
        return chore


def _report(chore: Future[Any]) -> None:
    error = None if chore.cancelled() else chore.exception()
    if error is not None:
        logger.error("a chore failed", exc_info=error)
