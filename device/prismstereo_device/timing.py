"""How the frame loop runs: frames counted, their rate, their stamps, and how long matching takes."""

from __future__ import annotations

import contextlib
import statistics
import time
from collections import deque
from collections.abc import Iterator

from prismstereo_hw.frame import RawFrame

__all__ = ["Timing"]

_KEPT = 32


class Timing:
    """Figures of the last frames, for one thread."""

    def __init__(self) -> None:
        self.frames = 0
        self.backward = 0  # stamps that are not after the one before
        self.frame_size: tuple[int, int] | None = None  # width, height of the newest frame
        self._stamp_us: int | None = None
        self._arrivals_s: deque[float] = deque(maxlen=_KEPT)
        self._matches_s: deque[float] = deque(maxlen=_KEPT)

    @property
    def rate_hz(self) -> float | None:
        """Frames a second of late; None before the second."""
        if len(self._arrivals_s) < 2:
            return None
        return (len(self._arrivals_s) - 1) / max(self._arrivals_s[-1] - self._arrivals_s[0], 1e-9)

    @property
    def match_ms(self) -> float | None:
        """The median of the last matches; None where nothing was matched."""
        return 1000 * statistics.median(self._matches_s) if self._matches_s else None

    def frame(self, frame: RawFrame) -> None:
        """Take in that a frame has come."""
        self.frames += 1
        self.frame_size = frame.width, frame.height
        self._arrivals_s.append(time.monotonic())
        if self._stamp_us is not None and frame.timestamp_us <= self._stamp_us:
            self.backward += 1
        self._stamp_us = frame.timestamp_us

    @contextlib.contextmanager
    def matching(self) -> Iterator[None]:
        """Time what is done in it."""
        began_s = time.perf_counter()
        yield
        self._matches_s.append(time.perf_counter() - began_s)
