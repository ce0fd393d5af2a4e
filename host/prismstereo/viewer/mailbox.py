"""What waits for one browser: of each kind the newest, and some words. A slow browser skips frames; nobody waits for it."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from prismstereo.viewer.message import Kind, LazyMessage

__all__ = ["Mailbox"]

_MOST_WORDS = 64


class Mailbox:
    """Filled by any thread, emptied by the one that serves a browser, which `wake` calls.

    Of each kind one message is on its way at a time: the next goes when the page says that it has the last.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._waiting: dict[Kind, LazyMessage] = {}
        self._under_way: dict[Kind, float] = {}
        self._words: deque[str] = deque(maxlen=_MOST_WORDS)
        self._status: str | None = None
        self.shown: frozenset[str] = frozenset()
        self.sent = self.skipped = 0
        self.delay_ms: float | None = None

    def put(self, kind: Kind, message: LazyMessage) -> None:
        """Take the newest of a kind; the one that still waited is skipped."""
        with self._lock:
            self.skipped += kind in self._waiting
            self._waiting[kind] = message
            ready = kind not in self._under_way
        if ready:
            self._wake()

    def tell(self, word: str) -> None:
        """Take a word; too many of them push out the oldest."""
        with self._lock:
            self._words.append(word)
        self._wake()

    def tell_status(self, status: str) -> None:
        """Take the state of things; the newest wins."""
        with self._lock:
            self._status = status
        self._wake()

    def words(self) -> list[str]:
        """Give the words that wait, and the state of things last."""
        with self._lock:
            words = [*self._words, *([] if self._status is None else [self._status])]
            self._words.clear()
            self._status = None
            return words

    def next(self) -> tuple[Kind, LazyMessage] | None:
        """Give a message whose kind the page has room for, disparity first; None where there is none."""
        with self._lock:
            for kind in sorted(self._waiting):
                if kind not in self._under_way:
                    self._under_way[kind] = time.monotonic()
                    self.sent += 1
                    return kind, self._waiting.pop(kind)
            return None

    def acknowledge(self, kind: int) -> None:
        """Hear that the page has the message of a kind; what is not under way is ignored."""
        with self._lock:
            known = next((one for one in self._under_way if one == kind), None)
            if known is None:
                return
            self.delay_ms = 1000 * (time.monotonic() - self._under_way.pop(known))
            ready = known in self._waiting
        if ready:
            self._wake()
