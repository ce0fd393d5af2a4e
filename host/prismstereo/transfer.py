"""Objects of the device, read and written in parts: whatever is lost is asked for again, whatever is cut goes on.

Parts travel several at a time. A read names the version that it began with and starts anew when the device holds another;
a write changes nothing until it is committed, and the device verifies the whole by its SHA-256 before that.
"""

from __future__ import annotations

import hashlib
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from prismstereo.requests import NotSent, OutcomeUnknown, Requests
from prismstereo_device.link import LinkLost
from prismstereo_device.objects import WriteStatus
from prismstereo_device.protocol import (
    ReadReply,
    ReadRequest,
    ReadStatus,
    WriteBegin,
    WriteCommit,
    WritePart,
    WriteReply,
)
from prismstereo_device.wire import LIMITS, WireError
from prismstereo_hw.errors import DataError, DeviceError, UsageError

__all__ = ["ObjectTransfer"]

_READ_WINDOW = 8
_WRITE_WINDOW = 4
_RESTARTS = 3
_PATIENCE_S = 20.0  # with no progress at all
_ASK_S = 4.0
_COMMIT_S = 10.0

Part = tuple[int, int]  # offset and length


class ObjectTransfer:
    """Reads and writes whole objects through `requests`; one at a time, whatever thread asks.

    `mtu` tells the largest payload of the session that is under way, `name` is the link's, for errors. A transfer that makes
    no progress for `patience_s` raises LinkLost.
    """

    def __init__(
        self, requests: Requests, mtu: Callable[[], int], name: str, *, patience_s: float = _PATIENCE_S
    ) -> None:
        self._requests = requests
        self._mtu = mtu
        self._name = name
        self._patience_s = patience_s
        self._busy = threading.Lock()

    def read(self, obj: int, most: int = LIMITS.object, version: int = 0) -> bytes:
        """Fetch a whole object of at most `most` bytes; of this `version`, or (0) of whichever is there.

        Raises LinkLost when the device does not answer, DataError when it has no such object, WireError when that is too
        large, DataError when it changes all the time.
        """
        with self._busy:
            for _ in range(_RESTARTS):
                content = _Download(self._requests, obj, version, most, self._name, self._patience_s).run()
                if content is not None:
                    return content
                if version:
                    raise DataError(
                        f"version {version} of object {obj} is no longer on {self._name}: ask for the newest"
                    )
        raise DataError(f"object {obj} on {self._name} changed {_RESTARTS} times while it was read: try again later")

    def write(self, obj: int, content: bytes) -> None:
        """Send a whole object and have it verified and taken; goes on where an earlier try with the same bytes was cut.

        Raises LinkLost when the device does not answer, UsageError where this object cannot be written, DataError with
        the device's own words where it refuses the content, DeviceError where its storage does.
        """
        if not content:
            raise UsageError(f"object {obj} of no bytes cannot be written to {self._name}: give its content")
        with self._busy:
            _Upload(self._requests, obj, content, self._mtu, self._name, self._patience_s).run()


class _Progress:
    """How long a transfer has been going nowhere."""

    def __init__(self, what: str, patience_s: float) -> None:
        self._what = what
        self._patience_s = patience_s
        self._moved_at_s = time.monotonic()

    def moved(self) -> None:
        self._moved_at_s = time.monotonic()

    def stuck(self, why: DeviceError) -> None:
        """Go on if it may still move, raise LinkLost if not."""
        if time.monotonic() - self._moved_at_s > self._patience_s:
            raise LinkLost(f"{self._what}: {why}") from why


class _Download:
    """One version of one object on its way to the desk."""

    def __init__(self, requests: Requests, obj: int, version: int, most: int, name: str, patience_s: float) -> None:
        self._requests = requests
        self._obj = obj
        self._most = most
        self._name = name
        self._progress = _Progress(f"object {obj} was not read from {name} to its end", patience_s)
        self._version = version
        self._content = bytearray()
        self._missing: deque[Part] = deque()
        self._asked: deque[tuple[Part, Future[bytes]]] = deque()

    def run(self) -> bytes | None:
        """Fetch it; None where the device replaced it meanwhile."""
        first = self._first()
        if first is None:
            return None
        self._content = bytearray(first.total)
        self._content[: len(first.data)] = first.data
        self._version = first.version
        length = max(1, len(first.data))
        self._missing.extend(
            (offset, min(length, first.total - offset)) for offset in range(len(first.data), first.total, length)
        )
        while self._missing or self._asked:
            while self._missing and len(self._asked) < _READ_WINDOW:
                part = self._missing.popleft()
                self._asked.append((part, self._ask(*part)))
            if not self._receive(*self._asked.popleft()):
                return None
        return bytes(self._content)

    def _ask(self, offset: int, length: int) -> Future[bytes]:
        return self._requests.ask(ReadRequest(self._obj, self._version, offset, length).pack(), _ASK_S)

    def _first(self) -> ReadReply | None:
        """Ask for the beginning until it comes: it tells version, size and how much one answer carries."""
        while True:
            try:
                return self._checked(self._ask(0, LIMITS.payload).result(), 0)
            except (OutcomeUnknown, NotSent) as error:
                self._progress.stuck(error)

    def _receive(self, part: Part, answer: Future[bytes]) -> bool:
        """Take the answer for one part; False where the version is no longer there."""
        offset, length = part
        try:
            reply = self._checked(answer.result(), offset)
        except (OutcomeUnknown, NotSent) as error:
            self._progress.stuck(error)
            self._missing.appendleft(part)
            return True
        if reply is None or reply.total != len(self._content):
            return False
        if not reply.data:
            raise WireError(f"object {self._obj} on {self._name} ends at {offset} of {reply.total} bytes")
        data = reply.data[:length]
        self._content[offset : offset + len(data)] = data
        if len(data) < length:  # another session, with smaller packets
            self._missing.appendleft((offset + len(data), length - len(data)))
        self._progress.moved()
        return True

    def _checked(self, body: bytes, offset: int) -> ReadReply | None:
        reply = ReadReply.unpack(body)
        if reply.status is ReadStatus.CHANGED:
            return None
        if reply.status is not ReadStatus.OK:
            words = reply.status.name.lower().replace("_", " ")
            raise DataError(f"object {self._obj} cannot be read from {self._name}: {words}")
        if reply.total > self._most:
            raise WireError(
                f"object {self._obj} on {self._name} has {reply.total} bytes: at most {self._most} are accepted"
            )
        if reply.obj != self._obj or reply.offset != offset or (self._version and reply.version != self._version):
            raise WireError(f"{self._name} answered for another part of object {self._obj} than was asked for")
        return reply


class _Upload:
    """One object on its way to the device."""

    def __init__(
        self, requests: Requests, obj: int, content: bytes, mtu: Callable[[], int], name: str, patience_s: float
    ) -> None:
        self._requests = requests
        self._obj = obj
        self._content = content
        self._mtu = mtu
        self._name = name
        self._progress = _Progress(f"object {obj} was not written to {name} to its end", patience_s)
        self._sha256 = hashlib.sha256(content).digest()
        self._begun = 0
        self._mismatches = 0

    def run(self) -> None:
        """Begin, send and commit, as often as the line or the device makes it necessary."""
        while True:
            try:
                if self._once():
                    return
                self._progress.stuck(LinkLost("the device forgot again and again how far it was"))
            except (OutcomeUnknown, NotSent) as error:
                # What was cut may be repeated: every step says absolutely what is to hold after it.
                self._progress.stuck(error)

    def _once(self) -> bool:
        begin = WriteBegin(self._obj, len(self._content), self._sha256)
        reply = self._step(begin.pack(), _ASK_S)
        return reply.status is WriteStatus.OK and self._send_from(reply.held) and self._commit()

    def _commit(self) -> bool:
        commit = WriteCommit(self._obj, len(self._content), self._sha256).pack()
        while True:
            try:
                return self._step(commit, _COMMIT_S).status is WriteStatus.OK
            except (OutcomeUnknown, NotSent) as error:
                self._progress.stuck(error)

    def _send_from(self, held: int) -> bool:
        """Send what is not held yet; False where the device knows nothing of this write any more."""
        offset, sent = held, deque[Future[bytes]]()
        while offset < len(self._content) or sent:
            while offset < len(self._content) and len(sent) < _WRITE_WINDOW:
                data = self._content[offset : offset + WritePart.room(self._mtu())]
                sent.append(self._requests.ask(WritePart(self._obj, self._sha256[:4], offset, data).pack(), _ASK_S))
                offset += len(data)
            reply = self._judge(sent.popleft().result())
            if reply.status is WriteStatus.GAP:  # a part before this one is late: those behind it were refused too
                replies = [self._judge(answer.result()) for answer in sent]
                sent.clear()
                offset = max(one.held for one in (reply, *replies))
            elif reply.status is not WriteStatus.OK:
                return False
            if reply.held > held:
                held = reply.held
                self._progress.moved()
        return True

    def _step(self, body: bytes, timeout_s: float) -> WriteReply:
        reply = self._judge(self._requests.ask(body, timeout_s).result())
        if reply.status is WriteStatus.MISMATCH:
            self._mismatches += 1
            if self._mismatches >= _RESTARTS:
                raise DeviceError(f"{self._name} received object {self._obj} damaged {_RESTARTS} times: {reply.why}")
        return reply

    def _judge(self, body: bytes) -> WriteReply:
        """Read an answer; raises what cannot be mended by sending again."""
        reply = WriteReply.unpack(body)
        said = f"object {self._obj} of {len(self._content)} bytes is not taken by {self._name}"
        why = reply.why or reply.status.name.lower().replace("_", " ")
        match reply.status:
            case WriteStatus.NO_SUCH_OBJECT | WriteStatus.TOO_LARGE:
                raise UsageError(f"{said}: {why}")
            case WriteStatus.REFUSED:
                raise DataError(f"{said}: {why}")
            case WriteStatus.NO_ROOM:
                raise DeviceError(f"{said}: {why}")
        return reply
