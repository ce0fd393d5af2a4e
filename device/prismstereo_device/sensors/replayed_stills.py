"""The stills of a recorded session, found by time; no more than two of them are in memory."""

from __future__ import annotations

from collections.abc import Iterator

from prismstereo_hw.frame import RawFrame
from prismstereo_hw.session import Session

__all__ = ["ReplayedStills"]


class ReplayedStills:
    """Follows a session's stills, which are in order of time, as its video goes on."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._coming: Iterator[RawFrame] = iter(())
        self._before: RawFrame | None = None
        self._after: RawFrame | None = None

    def nearest(self, timestamp_us: int) -> RawFrame:
        """Return the still nearest to a recorded time; `SessionError` for a damaged one."""
        if self._before is None or timestamp_us < self._before.timestamp_us:  # the first one, or from the front again
            self._coming = self._session.frames("stills")
            self._before = next(self._coming)
            self._after = next(self._coming, None)
        while self._after is not None and self._after.timestamp_us <= timestamp_us:
            self._before, self._after = self._after, next(self._coming, None)
        before, after = self._before, self._after
        if after is None or timestamp_us - before.timestamp_us <= after.timestamp_us - timestamp_us:
            return before
        return after
