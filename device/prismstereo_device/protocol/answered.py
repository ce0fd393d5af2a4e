"""At most once: the device's memory of requests it has answered, so that a repeated request is answered and not run again.

The host repeats a request until an answer comes; both may be lost, doubled or overtaken. Request numbers have 16 bits, rise by
one for each new request and wrap. Each channel with requests has a memory of its own, because channels overtake each other.
"""

from __future__ import annotations

from enum import Enum
from threading import Lock

from prismstereo_device.wire import LIMITS

__all__ = ["AnsweredRequests", "Verdict"]

_NUMBERS = 1 << 16
_HALF_RANGE = _NUMBERS // 2
_FORGET = _NUMBERS // 4  # an answer is gone long before its number comes round again


class Verdict(Enum):
    """What to do with a request that has no kept answer."""

    NEW = "run it, and keep the answer"
    STALE = "do not run it: it is too old to know whether it was run; tell the host so"
    UNDER_WAY = "do nothing: it is being run, and its answer will follow"


class AnsweredRequests:
    """The newest 128 answers of one channel in one session; may be asked and told by two threads."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._newest: int | None = None
        self._answers: dict[int, bytes | None] = {}  # None: under way; in the order in which requests came

    def clear(self) -> None:
        """Forget everything: another session begins, with numbers of its own."""
        with self._lock:
            self._newest = None
            self._answers.clear()

    def answer_to(self, msg_id: int) -> Verdict | bytes:
        """Judge a request by its number, 0..65535: the bytes of the answer that it got, or what to do.

        NEW marks it as under way: until `keep` is called its repeats are told so.
        """
        with self._lock:
            if msg_id in self._answers:
                answer = self._answers[msg_id]
                return Verdict.UNDER_WAY if answer is None else answer
            if self._newest is None or 0 < (msg_id - self._newest) % _NUMBERS < _HALF_RANGE:
                self._newest = msg_id
            elif (self._newest - msg_id) % _NUMBERS >= LIMITS.requests_outstanding:
                return Verdict.STALE
            self._answers[msg_id] = None
            self._forget()
            return Verdict.NEW

    def keep(self, msg_id: int, reply: bytes) -> None:
        """Keep the answer of a request that was NEW, in the session in which it was; what is no longer known is let go."""
        with self._lock:
            if msg_id in self._answers:
                self._answers[msg_id] = reply

    def _forget(self) -> None:
        assert self._newest is not None
        while len(self._answers) > LIMITS.replies_kept:
            del self._answers[next(iter(self._answers))]
        while (self._newest - (oldest := next(iter(self._answers)))) % _NUMBERS >= _FORGET:
            del self._answers[oldest]
