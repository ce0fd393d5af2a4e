"""The two ends of a bad line that programs open: pseudo-terminals or TCP servers, whose plug can be pulled."""

from __future__ import annotations

import contextlib
import os
import socket
from abc import ABC, abstractmethod
from pathlib import Path

from prismstereo_device.link.pty_port import PtyPort

__all__ = ["LineEnd", "PtyEnd", "TcpEnd"]

_BUFFER_BYTES = 8192  # so little that a line which halts is felt


class LineEnd(ABC):
    """A socket in the wall: its address stays, whoever is plugged into it comes and goes."""

    address: str

    @abstractmethod
    def descriptors(self) -> tuple[int | None, int | None]:
        """Give what carries bytes, and what has a newcomer waiting; None where there is none."""

    @abstractmethod
    def welcome(self) -> None:
        """Let the newcomer in; whoever was there before is gone."""

    @abstractmethod
    def read(self, most: int) -> bytes:
        """Take what is there without waiting; b"" where that is nothing."""

    @abstractmethod
    def write(self, data: bytes) -> int:
        """Hand over without waiting; how many bytes were taken, all of them where nobody is there."""

    @abstractmethod
    def unplug(self) -> None:
        """Pull the plug: whoever has it open finds it gone."""

    @abstractmethod
    def plug(self) -> None:
        """Put the plug in again."""


class PtyEnd(LineEnd):
    """A pseudo-terminal behind a symbolic link; each plugging-in makes a new one behind the same link."""

    def __init__(self, link_path: Path) -> None:
        self.address = str(link_path)
        self._link_path = link_path
        self._port: PtyPort | None = PtyPort(link_path)

    def descriptors(self) -> tuple[int | None, int | None]:
        """Give the descriptor of what is plugged in, and of what listens for newcomers."""
        return (None if self._port is None else self._port.fileno()), None

    def welcome(self) -> None:
        """Nobody knocks at a terminal."""

    def read(self, most: int) -> bytes:
        """Take what is there without waiting."""
        descriptor, _ = self.descriptors()
        if descriptor is None:
            return b""
        try:
            return os.read(descriptor, most)
        except OSError:
            return b""

    def write(self, data: bytes) -> int:
        """Hand over without waiting; how many bytes were taken."""
        descriptor, _ = self.descriptors()
        if descriptor is None:
            return len(data)
        try:
            return os.write(descriptor, data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)

    def unplug(self) -> None:
        """Pull the plug."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def plug(self) -> None:
        """Put the plug in again."""
        if self._port is None:
            self._port = PtyPort(self._link_path)


class TcpEnd(LineEnd):
    """A server on this computer, for one client at a time."""

    def __init__(self) -> None:
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None
        self._port = 0
        self.plug()
        self.address = f"tcp:127.0.0.1:{self._port}"

    def descriptors(self) -> tuple[int | None, int | None]:
        """Give the descriptor of what is plugged in, and of what listens for newcomers."""
        client, server = self._client, self._server
        return (client.fileno() if client is not None else None), (server.fileno() if server is not None else None)

    def welcome(self) -> None:
        """Let the newcomer in."""
        if self._server is None:
            return
        with contextlib.suppress(OSError):
            newcomer, _ = self._server.accept()
            self._leave()
            newcomer.settimeout(0.0)
            newcomer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = newcomer

    def read(self, most: int) -> bytes:
        """Take what is there without waiting."""
        if self._client is None:
            return b""
        try:
            data = self._client.recv(most)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._leave()
        return data

    def write(self, data: bytes) -> int:
        """Hand over without waiting; how many bytes were taken."""
        if self._client is None:
            return len(data)
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)

    def unplug(self) -> None:
        """Pull the plug."""
        self._leave()
        if self._server is not None:
            self._server.close()
            self._server = None

    def plug(self) -> None:
        """Put the plug in again."""
        if self._server is None:
            self._server = socket.create_server(("127.0.0.1", self._port), backlog=4)
            for side in (socket.SO_SNDBUF, socket.SO_RCVBUF):  # those who are let in inherit it
                self._server.setsockopt(socket.SOL_SOCKET, side, _BUFFER_BYTES)
            self._server.settimeout(0.0)
            self._port = int(self._server.getsockname()[1])

    def _leave(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
