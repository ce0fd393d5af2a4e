"""Two ends of a link inside one process: a line with a bounded buffer each way, as a cable has."""

from __future__ import annotations

import time
from threading import Condition

from prismstereo_device.link.base import Link, LinkLost
from prismstereo_device.link.pacing import Pacer, packet_bytes
from prismstereo_device.wire import LIMITS

__all__ = ["LoopbackLink", "loopback"]

_CAPACITY = 65536


class _Lane:
    """One direction: at most `capacity` bytes on their way."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._bytes = bytearray()
        self._changed = Condition()
        self._closed = False

    def put(self, data: bytes, timeout_s: float) -> int | None:
        """Take what fits in time; None where the lane is closed."""
        deadline = time.monotonic() + timeout_s
        taken = 0
        with self._changed:
            while taken < len(data):
                if self._closed:
                    return None
                room = self._capacity - len(self._bytes)
                if room:
                    part = data[taken : taken + room]
                    self._bytes += part
                    taken += len(part)
                    self._changed.notify_all()
                elif not self._changed.wait(max(0.0, deadline - time.monotonic())) and time.monotonic() >= deadline:
                    break
        return taken

    def get(self, timeout_s: float) -> bytes | None:
        """Wait for bytes; None where the lane is closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._bytes or self._closed, timeout_s)
            if self._closed and not self._bytes:
                return None
            data = bytes(self._bytes)
            self._bytes.clear()
            self._changed.notify_all()
            return data

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class LoopbackLink(Link):
    """One end of the line that `loopback` makes; closing either end closes the line."""

    def __init__(self, name: str, incoming: _Lane, outgoing: _Lane, mtu: int, bytes_per_s: float | None = None) -> None:
        super().__init__(name, mtu, bytes_per_s)
        self._incoming = incoming
        self._outgoing = outgoing
        self._pacer = None if bytes_per_s is None else Pacer(bytes_per_s, packet_bytes(mtu))

    def read(self, timeout_s: float) -> bytes:
        """Wait for at least one byte and return everything that is there; b"" when the time is over."""
        data = self._incoming.get(timeout_s)
        if data is None:
            raise LinkLost(f"the line {self.name} is closed")
        return data

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        """Hand over bytes; returns how many were taken in time."""
        if self._pacer is not None:
            return self._pacer.write(data, timeout_s, self._put)
        return self._put(data, timeout_s)

    def _put(self, data: bytes, timeout_s: float) -> int:
        taken = self._outgoing.put(data, timeout_s)
        if taken is None:
            raise LinkLost(f"the line {self.name} is closed")
        return taken

    def close(self) -> None:
        """End the line; what is on its way can still be read at the other end."""
        self._incoming.close()
        self._outgoing.close()


def loopback(
    mtu: int = LIMITS.payload, capacity: int = _CAPACITY, *, bytes_per_s: float | None = None
) -> tuple[LoopbackLink, LoopbackLink]:
    """Make a line with `capacity` bytes of buffer each way; returns the camera's end and the host's.

    Each end writes at `bytes_per_s`, as to a serial line; None: at once.
    """
    to_host, to_device = _Lane(capacity), _Lane(capacity)
    return (
        LoopbackLink("loopback", to_device, to_host, mtu, bytes_per_s),
        LoopbackLink("loopback", to_host, to_device, mtu, bytes_per_s),
    )
