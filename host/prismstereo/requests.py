"""Requests and their answers on one channel: asked again until they are answered, and never run twice by our doing.

The device runs a request at most once in a session, however often it is repeated. So a request is repeated within its
session only: when that ends with no answer, nobody can know whether it was run, and the asker is told just that.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Protocol

from prismstereo.round_trip import RoundTrip
from prismstereo_device.framing import Packet
from prismstereo_device.link import LinkLost
from prismstereo_device.wire import LIMITS, REPLY, Channel
from prismstereo_hw.errors import DeviceError

__all__ = ["NotSent", "OutcomeUnknown", "Requests", "SendRequest"]

_ID = 0xFFFF
_FIRST_ID = 0xFFF0  # just below the wrap, so that the wrap is no rare event
_UNSENT_AGAIN_S = 0.02


class OutcomeUnknown(DeviceError):
    """A request went out and no answer came: it may have been run or not. Ask what is in force, then decide."""


class NotSent(LinkLost):
    """A request that never left: the sensor was not there all the time that it was given."""


class SendRequest(Protocol):
    """Writes one packet of a session, or knows for certain that none of it left."""

    def __call__(self, channel: Channel, payload: bytes, *, msg: int, session: int) -> bool:
        """Write it if `session` is the one that is under way and may be asked; False: nothing was written."""
        ...


@dataclass(slots=True, eq=False)
class _Pending:
    """A request on its way; `sent` as soon as the device may have got it."""

    number: int
    body: bytes
    session: int
    asked_at_s: float
    sent_at_s: float
    give_up_s: float
    due_s: float
    sent: bool = True
    tries: int = 1
    answer: Future[bytes] = field(default_factory=Future)


class Requests:
    """The requests of one channel; any thread may `ask`, `tick` is called again and again by one, `take` by another.

    At most 32 numbers lie between the oldest unanswered request and the newest, so that none ever looks stale to the
    device. Every future ends: with the answer's body, with OutcomeUnknown, or with NotSent (or what was given
    to `end`) where nothing of it ever left.
    """

    def __init__(
        self,
        channel: Channel,
        send: SendRequest,
        round_trip: RoundTrip,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._channel = channel
        self._send = send
        self._round_trip = round_trip
        self._clock_s = clock_s
        self._changed = threading.Condition()
        self._pending: dict[int, _Pending] = {}  # oldest first
        self._next = _FIRST_ID
        self._session = 0
        self._over: DeviceError | None = None
        self._repeated = 0

    @property
    def repeated(self) -> int:
        """How many times a request was sent again."""
        return self._repeated

    @property
    def room(self) -> int:
        """How many requests may be asked before one has to wait."""
        if not self._pending:
            return LIMITS.requests_outstanding
        oldest = next(iter(self._pending))
        return LIMITS.requests_outstanding - ((self._next - oldest) & _ID)

    def ask(self, body: bytes, timeout_s: float = 5.0) -> Future[bytes]:
        """Send a request, after a wait for room if need be; its future ends within `timeout_s` from then."""
        with self._changed:
            self._changed.wait_for(lambda: self.room > 0 or self._over is not None)
            if self._over is not None:
                failed: Future[bytes] = Future()
                failed.set_exception(self._over)
                return failed
            now_s = self._clock_s()
            due_s = now_s + self._round_trip.patience_s
            pending = _Pending(self._next, body, self._session, now_s, now_s, now_s + timeout_s, due_s)
            self._pending[pending.number] = pending
            self._next = (self._next + 1) & _ID
        self._write(pending)
        return pending.answer

    def take(self, packet: Packet) -> None:
        """Take a packet of the channel that came from the device."""
        if not packet.flags & REPLY:
            return
        with self._changed:
            pending = self._pending.pop(packet.msg, None)
            if pending is None:
                return  # the answer to a repetition of what was answered already
            if pending.tries == 1:
                self._round_trip.answered(self._clock_s() - pending.sent_at_s)
            self._changed.notify_all()
        pending.answer.set_result(packet.payload)

    def tick(self) -> float:
        """Send again what is overdue and give up what is too old; returns the time at which to come again."""
        now_s = self._clock_s()
        late: list[_Pending] = []
        with self._changed:
            expired = [pending for pending in self._pending.values() if pending.give_up_s <= now_s]
            for pending in expired:
                del self._pending[pending.number]
            for pending in self._pending.values():
                if pending.due_s <= now_s and (not pending.sent or self._round_trip.may_repeat(now_s)):
                    pending.tries += pending.sent
                    self._repeated += pending.sent
                    pending.sent, pending.sent_at_s = True, now_s
                    pending.due_s = now_s + self._round_trip.patience_s
                    late.append(pending)
            self._changed.notify_all()
        for pending in expired:
            pending.answer.set_exception(_unanswered(pending, f"within {pending.give_up_s - pending.asked_at_s:g} s"))
        for pending in late:
            self._write(pending)
        with self._changed:
            allowed_s = self._round_trip.repeat_after_s
            return min(
                (max(pending.due_s, allowed_s if pending.sent else 0.0) for pending in self._pending.values()),
                default=now_s + 1.0,
            )

    def begin_session(self, session: int) -> None:
        """Go on in another session: what the device may have got in the one before ends as unknown, the rest is sent now."""
        with self._changed:
            self._session = session
            unknown = [pending for pending in self._pending.values() if pending.sent]
            for pending in unknown:
                del self._pending[pending.number]
            for pending in self._pending.values():
                pending.session = session
                pending.due_s = self._clock_s()
            self._changed.notify_all()
        for pending in unknown:
            pending.answer.set_exception(_unanswered(pending, "before the session ended (a replug, or a restart)"))

    def end(self, error: DeviceError) -> None:
        """Let nothing wait any longer: `error` for what was not sent and for all that is asked from now on."""
        with self._changed:
            self._over = self._over or error
            pending_ones = list(self._pending.values())
            self._pending.clear()
            self._changed.notify_all()
        for pending in pending_ones:
            pending.answer.set_exception(_unanswered(pending, f"before the end ({error})") if pending.sent else error)

    def _write(self, pending: _Pending) -> None:
        if self._send(self._channel, pending.body, msg=pending.number, session=pending.session):
            return
        with self._changed:  # if its session ended meanwhile it is no longer here, and unknown to be on the safe side
            if pending.tries == 1:
                pending.sent = False
            pending.due_s = self._clock_s() + _UNSENT_AGAIN_S


def _unanswered(pending: _Pending, when: str) -> DeviceError:
    if not pending.sent:
        return NotSent(f"a request could not be sent {when}: the sensor is not there; check the cable, then ask again")
    return OutcomeUnknown(
        f"a request was sent {pending.tries} times and not answered {when}: it may or may not have been run; "
        "ask what is in force before you send it again"
    )
