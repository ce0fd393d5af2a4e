"""A lower rate than the camera's: frames left out by their stamps."""

from __future__ import annotations

__all__ = ["Thinning"]

_EARLY = 0.25  # of a period: frames do not come exactly on time


class Thinning:
    """Keeps `rate_hz` frames a second of those that come; all of them where they come no faster."""

    def __init__(self, rate_hz: float) -> None:
        self._period_us = 1e6 / rate_hz
        self._due_us: float | None = None

    def keeps(self, timestamp_us: int) -> bool:
        """Tell whether the frame of this time is one to give; a clock that jumped back begins anew."""
        due = self._due_us
        if due is None or abs(timestamp_us - due) > 10 * self._period_us:
            due = float(timestamp_us)
        if timestamp_us < due - _EARLY * self._period_us:
            return False
        self._due_us = max(due + self._period_us, timestamp_us + _EARLY * self._period_us)
        return True
