"""What waits for the disk: bounded, and the thread that reads the line is never held up."""

from __future__ import annotations

from collections import deque
from threading import Condition
from typing import Generic, TypeVar

__all__ = ["Waiting"]

T = TypeVar("T")


class Waiting(Generic[T]):
    """A queue of things with their sizes; what would not fit `most_bytes` is dropped and counted."""

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._things: deque[T] = deque()
        self._bytes = 0
        self._changed = Condition()
        self._closed = False
        self.dropped = 0

    @property
    def closed(self) -> bool:
        """Whether nothing more is taken in."""
        return self._closed

    def put(self, thing: T, size: int) -> None:
        """Add a thing, at once."""
        with self._changed:
            if self._closed:
                return
            if self._bytes + size > self._most_bytes:
                self.dropped += 1
                return
            self._things.append(thing)
            self._bytes += size
            if len(self._things) == 1:
                self._changed.notify()

    def take(self, timeout_s: float) -> list[T]:
        """Wait for things, and take all that are there; nothing when the time is over, or it is closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._things or self._closed, timeout_s)
            things = list(self._things)
            self._things.clear()
            self._bytes = 0
            return things

    def close(self) -> None:
        """Take nothing more in; what waits can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
