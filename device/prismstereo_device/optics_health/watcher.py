"""Looks at the optics now and then, in a thread of its own: a look takes longer than a frame may."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import DisparityMap
from prismstereo_device.optics_health.health import OpticsHealth, OpticsReport
from prismstereo_device.optics_health.look import take_look
from prismstereo_device.rectify import RectifiedPair

__all__ = ["OpticsWatcher"]

_PERIOD_S = 10.0


@dataclass(frozen=True, slots=True)
class _Shown:
    """What one look is taken at."""

    raw: NDArray[np.uint8]
    pair: RectifiedPair
    disparity: DisparityMap | None


class OpticsWatcher:
    """Takes a look every `period_s` at what the frame loop shows it; a context manager, and `close` ends its thread.

    The frame loop asks `due`, and if so calls `show`, which returns at once.
    """

    def __init__(self, health: OpticsHealth, period_s: float = _PERIOD_S) -> None:
        self._health = health
        self._period_s = period_s
        self._changed = threading.Condition()
        self._shown: _Shown | None = None
        self._closed = False
        self._due_at_s = 0.0
        self._report = health.report()
        self._reference = health.reference
        self._thread = threading.Thread(target=self._run, name="prismstereo-optics", daemon=True)
        self._thread.start()

    @property
    def due(self) -> bool:
        """Whether it is time for a look, and none is under way."""
        return self._shown is None and time.monotonic() >= self._due_at_s

    @property
    def report(self) -> OpticsReport:
        """What the looks so far say."""
        return self._report

    @property
    def reference(self) -> dict[str, float]:
        """What was learned of the unit as it was calibrated; empty before a few looks."""
        return dict(self._reference)

    def hurry(self) -> None:
        """Take the next look as soon as a frame is there."""
        self._due_at_s = 0.0

    def show(self, raw: NDArray[np.uint8], pair: RectifiedPair, disparity: DisparityMap | None) -> None:
        """Let it look at a raw frame (height, width[, 3]), its rectified pair and what was matched; nobody may change them."""
        with self._changed:
            if self._shown is None:
                self._shown = _Shown(raw, pair, disparity)
                self._due_at_s = time.monotonic() + self._period_s
                self._changed.notify()

    def close(self) -> None:
        """End the thread; closing twice does no harm."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._shown is not None or self._closed)
                shown = self._shown
            if self._closed or shown is None:
                return
            self._health.add(take_look(shown.raw, shown.pair), shown.pair, shown.disparity)
            self._report, self._reference = self._health.report(), self._health.reference
            with self._changed:
                self._shown = None
