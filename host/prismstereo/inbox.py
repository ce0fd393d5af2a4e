"""Where what arrives waits for whoever reads it: bounded, newest wins, with an end."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from threading import Condition
from types import TracebackType
from typing import Generic, Self, TypeVar

from prismstereo_hw.errors import DeviceError

__all__ = ["Inbox", "Stream"]

T = TypeVar("T")


class Inbox(Generic[T]):
    """At most `capacity` things; a further one pushes the oldest out, which is counted.

    With `keep_all` none is pushed out: `room` tells the sender to wait instead, and the few that were already on their way
    are kept above the capacity.
    """

    def __init__(self, capacity: int, *, keep_all: bool = False) -> None:
        self._capacity = capacity
        self._keep_all = keep_all
        self._waiting: deque[T] = deque()
        self._changed = Condition()
        self._ended = False
        self._error: DeviceError | None = None
        self._not_taken = 0

    @property
    def not_taken(self) -> int:
        """How many were pushed out before anybody took them."""
        return self._not_taken

    @property
    def room(self) -> int | None:
        """How many more may be sent; None: any number, as the oldest goes."""
        return max(0, self._capacity - len(self._waiting)) if self._keep_all else None

    @property
    def ended(self) -> bool:
        """Whether nothing follows."""
        return self._ended

    def put(self, item: T) -> None:
        """Add the newest."""
        with self._changed:
            if len(self._waiting) >= self._capacity and not self._keep_all:
                self._waiting.popleft()
                self._not_taken += 1
            self._waiting.append(item)
            self._changed.notify()

    def end(self, error: DeviceError | None = None) -> None:
        """Say that nothing follows, and why; the first reason stays."""
        with self._changed:
            if not self._ended:
                self._ended = True
                self._error = error
            self._changed.notify_all()

    def take(self, timeout_s: float | None = None) -> T | None:
        """Wait for the oldest; None at a good end or when the time is over, what was given to `end` is raised at a bad one."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._ended, timeout_s)
            if self._waiting:
                return self._waiting.popleft()
            if self._error is not None:
                raise self._error
            return None


class Stream(Generic[T]):
    """An iterator over what arrives on one channel from now on, newest wins; close it, or leave its `with`, when done.

    Ends when the camera is closed; raises LinkLost when it is lost for good.
    """

    def __init__(self, inbox: Inbox[T], leave: Callable[[Inbox[T]], None]) -> None:
        self._inbox = inbox
        self._leave = leave

    @property
    def not_taken(self) -> int:
        """How many were pushed out by newer ones before they were taken."""
        return self._inbox.not_taken

    def take(self, timeout_s: float | None = None) -> T | None:
        """Wait for the oldest that waits; None when the time is over, or at the end."""
        return self._inbox.take(timeout_s)

    def close(self) -> None:
        """Receive no more; closing twice does no harm."""
        self._leave(self._inbox)
        self._inbox.end()

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        item = self._inbox.take()
        if item is None:
            raise StopIteration
        return item

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
