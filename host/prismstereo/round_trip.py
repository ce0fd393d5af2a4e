"""How long an answer takes on this line, and how soon to ask again.

As in TCP: the patience is the mean round trip plus four times its spread, doubled whenever an answer is overdue, and kept
doubled until a request is answered at the first try (Karn): the answer to a repeated one does not tell which it answers.
"""

from __future__ import annotations

import math
import threading

__all__ = ["RoundTrip"]

_LEAST_S = 0.05
_MOST_S = 1.0
_UNKNOWN_S = 0.25  # before the first answer
_REPEATS_PER_PATIENCE = 8


class RoundTrip:
    """The round trips of one line, shared by all that ask on it; times are seconds of one monotonic clock.

    Every requester asks `may_repeat` before it repeats: all of them together repeat at most once in an eighth of the
    patience, so that a line that is overfull is not filled further. For any thread.
    """

    def __init__(self) -> None:
        self._changing = threading.Lock()
        self._mean_s = math.nan
        self._spread_s = 0.0
        self._doubled = 1.0
        self._double_after_s = -math.inf
        self._repeat_after_s = -math.inf

    @property
    def patience_s(self) -> float:
        """How long to wait for an answer before asking again, 50 ms to 1 s."""
        patience_s = _UNKNOWN_S if math.isnan(self._mean_s) else self._mean_s + 4 * self._spread_s
        return min(_MOST_S, max(_LEAST_S, patience_s) * self._doubled)

    @property
    def repeat_after_s(self) -> float:
        """The time from which on the next repetition is allowed."""
        return self._repeat_after_s

    def answered(self, took_s: float) -> None:
        """Learn from a request that was answered at the first try."""
        with self._changing:
            if math.isnan(self._mean_s):
                self._mean_s, self._spread_s = took_s, took_s / 2
            else:
                self._spread_s += (abs(took_s - self._mean_s) - self._spread_s) / 4
                self._mean_s += (took_s - self._mean_s) / 8
            self._doubled = 1.0

    def may_repeat(self, now_s: float) -> bool:
        """Whether one overdue request may be repeated now; if so, it counts as done and patience grows."""
        with self._changing:
            if now_s < self._repeat_after_s:
                return False
            if now_s >= self._double_after_s and self.patience_s < _MOST_S:
                # Requests that are overdue together were lost together: they double it once.
                self._double_after_s = now_s + self.patience_s
                self._doubled *= 2
            self._repeat_after_s = now_s + self.patience_s / _REPEATS_PER_PATIENCE
            return True
