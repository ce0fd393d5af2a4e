"""What systemd is told: that the service is ready, what it does, that its frame loop is alive, that it stops.

The watchdog is fed from the frame loop alone, so that a service whose heartbeats go on but whose frames do not is restarted.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Self

__all__ = ["Notifier"]

logger = logging.getLogger(__name__)

_KICKS_PER_PERIOD = 4
_LONGEST_STATUS = 200


class Notifier:
    """Sends to the socket that the service manager named; without one it does nothing. For several threads at once.

    `address` is the socket's path, or, beginning with '@', its abstract name. `watchdog_s` is how long the service manager
    waits for a sign of life; None: it does not wait. `clock_s` is a monotonic clock.
    """

    def __init__(
        self,
        address: str | None = None,
        watchdog_s: float | None = None,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._address = address
        self._every_s = None if watchdog_s is None else watchdog_s / _KICKS_PER_PERIOD
        self._clock_s = clock_s
        self._kick_at_s = clock_s()
        self._told_ready = self._told_stopping = False
        self._status = ""
        self._socket: socket.socket | None = None
        if address is not None:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.settimeout(0.0)  # a manager that does not read must not stop the frames

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> Self:
        """Read NOTIFY_SOCKET and WATCHDOG_USEC (which counts where WATCHDOG_PID is this process, or is not given).

        What makes no sense there, or is not to be had on this system, is as good as not given.
        """
        given = os.environ if environment is None else environment
        address = given.get("NOTIFY_SOCKET", "")
        if address[:1] not in ("/", "@") or not hasattr(socket, "AF_UNIX"):
            return cls()
        microseconds = given.get("WATCHDOG_USEC", "")
        watched = given.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        usable = watched and microseconds.isascii() and microseconds.isdigit() and int(microseconds) > 0
        return cls(address, int(microseconds) / 1e6 if usable else None)

    def ready(self) -> None:
        """Say, the first time only, that the service is up."""
        if not self._told_ready:
            self._told_ready = True
            self._send("READY=1")

    def status(self, text: str) -> None:
        """Say in a line what the service does now; the same line again is not sent."""
        line = " ".join(text.split())[:_LONGEST_STATUS]
        if line != self._status:
            self._status = line
            self._send(f"STATUS={line}")

    def kick(self) -> None:
        """Show that the frame loop lives; sent four times in the watchdog's time at most, however often it is called."""
        now_s = self._clock_s()
        if self._every_s is not None and now_s >= self._kick_at_s:
            self._kick_at_s = now_s + self._every_s
            self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """Say, the first time only, that the service ends."""
        if not self._told_stopping:
            self._told_stopping = True
            self._send("STOPPING=1")

    def close(self) -> None:
        """Give the socket back; nothing is sent any more."""
        open_socket, self._socket = self._socket, None
        if open_socket is not None:
            open_socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _send(self, line: str) -> None:
        open_socket, address = self._socket, self._address
        if open_socket is None or address is None:
            return
        try:
            open_socket.sendto(line.encode(), "\0" + address[1:] if address[0] == "@" else address)
        except OSError as error:  # the frames matter more than who watches them
            logger.debug("the service manager was not told %s: %s", line, error)
