"""Reading an object of the device, part by part: whatever is lost on the line is asked for again."""

from __future__ import annotations

import queue
import threading
from typing import Protocol

from prismstereo_device.framing import Packet
from prismstereo_device.link import LinkLost
from prismstereo_device.protocol import ReadReply, ReadRequest, ReadStatus
from prismstereo_device.wire import LIMITS, REPLY, Channel, WireError
from prismstereo_hw.errors import DataError

__all__ = ["ObjectReader", "SendPacket"]

_FIRST_WAIT_S = 0.25
_LONGEST_WAIT_S = 1.0
_TRIES = 8
_RESTARTS = 3
_REQUEST = 0xFFFF


class SendPacket(Protocol):
    """Writes one packet; may lose it."""

    def __call__(self, channel: Channel, payload: bytes, flags: int = 0, msg: int = 0) -> None:
        """Write a packet on `channel` with this payload, these flags and this request number."""
        ...


class ObjectReader:
    """Asks with `send` and is told with `answer`, by another thread; one object at a time."""

    def __init__(self, send: SendPacket) -> None:
        self._send = send
        self._reading = threading.Lock()
        self._answers: queue.SimpleQueue[Packet | None] = queue.SimpleQueue()
        self._request = 0
        self._ended = threading.Event()

    def answer(self, packet: Packet) -> None:
        """Take a packet of the bulk channel."""
        if packet.flags & REPLY:
            self._answers.put(packet)

    def end(self) -> None:
        """Say that no answer will come."""
        self._ended.set()
        self._answers.put(None)

    def read(self, obj: int, most: int, name: str) -> bytes:
        """Fetch a whole object of at most `most` bytes; `name` is the link's, for errors.

        Raises LinkLost when the device does not answer, DataError when it has no such object or changes it all the time.
        """
        with self._reading:
            for _ in range(_RESTARTS):
                content = self._read_once(obj, most, name)
                if content is not None:
                    return content
        raise DataError(f"object {obj} on {name} changed {_RESTARTS} times while it was read: try again later")

    def _read_once(self, obj: int, most: int, name: str) -> bytes | None:
        """Fetch one version of an object; None when it is replaced meanwhile."""
        content = bytearray()
        version = 0
        while True:
            reply = self._ask(ReadRequest(obj, version, len(content), LIMITS.payload), name)
            if reply.status is ReadStatus.CHANGED:
                return None
            if reply.status is not ReadStatus.OK:
                raise DataError(f"object {obj} cannot be read from {name}: {reply.status.name.lower()}")
            if reply.total > most:
                raise WireError(f"object {obj} on {name} has {reply.total} bytes: at most {most} are accepted")
            version = reply.version
            content += reply.data
            if len(content) >= reply.total:
                return bytes(content)
            if not reply.data:
                raise WireError(f"object {obj} on {name} ends at {len(content)} of {reply.total} bytes")

    def _ask(self, request: ReadRequest, name: str) -> ReadReply:
        self._request = (self._request + 1) & _REQUEST
        wait_s = _FIRST_WAIT_S
        for _ in range(_TRIES):
            if self._ended.is_set():
                break
            self._send(Channel.BULK, request.pack(), 0, self._request)
            reply = self._await(request, wait_s)
            if reply is not None:
                return reply
            wait_s = min(2 * wait_s, _LONGEST_WAIT_S)
        raise LinkLost(f"the sensor on {name} did not give bytes {request.offset}.. of object {request.obj}")

    def _await(self, request: ReadRequest, wait_s: float) -> ReadReply | None:
        """Wait for the answer to the newest request, past late answers to earlier ones."""
        while True:
            try:
                packet = self._answers.get(timeout=wait_s)
            except queue.Empty:
                return None
            if packet is None:
                return None
            if packet.msg != self._request:
                continue
            try:
                reply = ReadReply.unpack(packet.payload)
            except WireError:
                continue
            if reply.obj == request.obj and reply.offset == request.offset:
                return reply
