"""The same stream over TCP: a server for the camera, a client for the host.

There is no password: whoever reaches the server's address can read the camera. It listens on this computer alone unless
it is told otherwise.
"""

from __future__ import annotations

import contextlib
import select
import socket
import sys
import time

from prismstereo_device.link.base import Link, LinkLost, PortError
from prismstereo_device.wire import LIMITS

__all__ = ["TcpClient", "TcpServer"]

_MOST = 65536
_BUFFER_BYTES = 65536  # each way: 60 MB/s at a millisecond there and back, and no more than 0.2 MB that nobody has read
_UNSENT_BYTES = 16384  # of these, what has not left yet: a newer packet waits for no more
_LAST_READS = 16
_TCP_NOTSENT_LOWAT = 25  # Linux's number; Python names it from 3.12 on


class TcpClient(Link):
    """A connection to a camera's server; raises PortError where there is none."""

    def __init__(self, host: str, port: int, timeout_s: float = 5.0, mtu: int = LIMITS.payload) -> None:
        super().__init__(f"tcp:{host}:{port}", mtu)
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except (OSError, OverflowError, ValueError) as error:  # ValueError: a host name that cannot be one
            raise PortError(
                f"{self.name} cannot be reached ({error}): check the address, and that a sensor is served there"
            ) from error
        _prepare(self._socket)

    def read(self, timeout_s: float) -> bytes:
        """Wait for at least one byte and return everything that is there; b"" when the time is over."""
        try:
            if not _readable(self._socket, timeout_s):
                return b""
            data = self._socket.recv(_MOST)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:
            raise self._lost(str(error)) from error
        if not data:
            raise self._lost("the other end closed it")
        return data

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        """Hand over bytes; returns how many were taken in time."""
        try:
            return _send_some(self._socket, data, timeout_s)
        except (OSError, ValueError) as error:
            raise self._lost(str(error)) from error

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def _lost(self, why: str) -> LinkLost:
        return LinkLost(f"the connection {self.name} is gone ({why}): check the sensor, then open it again")


class TcpServer(Link):
    """A server that talks to one client at a time and outlives them all.

    While nobody is connected reading waits and writing goes nowhere. A second client is turned away at once, unless the
    first has been silent for `silent_s`. Port 0 takes any free one; `name` tells which. Raises PortError.
    """

    def __init__(
        self, host: str = "127.0.0.1", port: int = 0, *, mtu: int = LIMITS.payload, silent_s: float = 3.0
    ) -> None:
        self._silent_s = silent_s
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            self._listener = socket.create_server((host, port), family=family, backlog=4)
        except (OSError, OverflowError) as error:
            raise PortError(
                f"tcp:{host}:{port} cannot be served ({error}): give an address of this computer and a free port"
            ) from error
        self._listener.settimeout(0.0)
        self.port = int(self._listener.getsockname()[1])
        super().__init__(f"tcp:{host}:{self.port}", mtu)
        self._client: socket.socket | None = None
        self._heard_at = 0.0

    def read(self, timeout_s: float) -> bytes:
        """Wait for a client, or for bytes of the one there is, and return them; b"" when the time is over."""
        client = self._client
        try:
            ready, _, _ = select.select([self._listener, *([client] if client else [])], [], [], timeout_s)
        except (OSError, ValueError) as error:
            raise LinkLost(f"the server {self.name} is closed ({error})") from error
        data = self._receive() if client in ready else b""
        if self._listener in ready:
            for _ in range(_LAST_READS):  # the one who is there may have left: the end comes after its last bytes
                if not (more := self._receive()):
                    break
                data += more
            self._admit()
        return data

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        """Hand over bytes to the client; returns how many were taken in time, all of them where there is no client."""
        client = self._client
        if client is None:
            if self._listener.fileno() < 0:
                raise LinkLost(f"the server {self.name} is closed")
            return len(data)
        try:
            return _send_some(client, data, timeout_s)
        except (OSError, ValueError):
            return len(data)  # the reading side sees the end and makes room for the next client

    def close(self) -> None:
        """Turn the client away and give the port back."""
        self._drop()
        self._listener.close()

    def _admit(self) -> None:
        with contextlib.suppress(OSError):  # a client that is gone again already
            newcomer, _ = self._listener.accept()
            if self._client is not None and time.monotonic() - self._heard_at < self._silent_s:
                newcomer.close()
                return
            self._drop()
            _prepare(newcomer)
            self._client = newcomer
            self._heard_at = time.monotonic()

    def _receive(self) -> bytes:
        """Take what the client has sent; at its end it is dropped."""
        if self._client is None:
            return b""
        try:
            data = self._client.recv(_MOST)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if data:
            self._heard_at = time.monotonic()
        else:
            self._drop()
        return data

    def _drop(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()


def _prepare(connection: socket.socket) -> None:
    connection.settimeout(0.0)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for side in (socket.SO_SNDBUF, socket.SO_RCVBUF):  # left to itself, a system keeps megabytes of old frames
        connection.setsockopt(socket.SOL_SOCKET, side, _BUFFER_BYTES)
    if sys.platform == "linux":
        connection.setsockopt(socket.IPPROTO_TCP, _TCP_NOTSENT_LOWAT, _UNSENT_BYTES)


def _readable(connection: socket.socket, timeout_s: float) -> bool:
    ready, _, _ = select.select([connection], [], [], timeout_s)
    return bool(ready)


def _send_some(connection: socket.socket, data: bytes, timeout_s: float) -> int:
    deadline = time.monotonic() + timeout_s
    rest = memoryview(data)
    while rest:
        try:
            rest = rest[connection.send(rest) :]
        except BlockingIOError:
            left = deadline - time.monotonic()
            if left <= 0:
                break
            select.select([], [connection], [], left)
    return len(data) - len(rest)
