"""The camera's pulse: once a second, and when the stream ends, how it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from prismstereo_device.framing import LineStatistics
from prismstereo_device.protocol.health import Health, HealthFlag
from prismstereo_device.serving.rate_control import Mode

__all__ = ["Pulse", "ServiceStatistics"]

_PERIOD_S = 1.0


@dataclass(frozen=True, slots=True)
class ServiceStatistics:
    """Counters of a service.

    Frames `captured`; disparity frames `sent` whole and `dropped`; pictures dropped; `sessions` begun; messages that were
    `ignored` because they were not understood; and what came over the line.
    """

    captured: int
    sent: int
    dropped: int
    pictures_dropped: int
    sessions: int
    ignored: int
    line: LineStatistics


class Pulse:
    """Says when a health report is due, and makes it. `clock_us` is the device's clock; the others are asked each time."""

    def __init__(
        self,
        clock_us: Callable[[], int],
        temperature_c: Callable[[], float | None],
        last_error: Callable[[], str],
    ) -> None:
        self._clock_us = clock_us
        self._temperature_c = temperature_c
        self._last_error = last_error
        self._started_us = self._counted_us = clock_us()
        self._counted_bytes = 0
        self._bytes_per_s = 0
        self._due_s = 0.0
        self._told_end = False

    def hurry(self) -> None:
        """Make the next report due now."""
        self._due_s = 0.0

    def due(self, now_s: float, ended: bool) -> bool:
        """Whether a report is due; asking makes the next one due a second later."""
        if now_s < self._due_s and ended is self._told_end:
            return False
        self._due_s, self._told_end = now_s + _PERIOD_S, ended
        return True

    def report(
        self, counts: ServiceStatistics, mode: Mode | None, written_bytes: int, flags: HealthFlag, failure: str
    ) -> Health:
        """Make the report of now. `mode` None: codec 1. `written_bytes` counts since the start."""
        now_us = self._clock_us()
        if now_us > self._counted_us:
            self._bytes_per_s = (written_bytes - self._counted_bytes) * 1_000_000 // (now_us - self._counted_us)
            self._counted_us, self._counted_bytes = now_us, written_bytes
        return Health(
            frames_captured=counts.captured,
            frames_sent=counts.sent,
            frames_dropped=counts.dropped,
            packets_good=counts.line.good,
            packets_bad=counts.line.bad,
            packets_oversize=counts.line.oversize,
            uptime_us=now_us - self._started_us,
            temperature_c=self._temperature_c(),
            flags=flags,
            bound=None if mode is None else mode.bound,
            half_resolution=mode is not None and mode.halved,
            pictures_dropped=counts.pictures_dropped,
            line_bytes_per_s=self._bytes_per_s,
            last_error=failure or self._last_error(),
        )
