"""What a link is: bytes out, bytes in, one other end; and the two ways in which it can fail."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

from prismstereo_device.wire import LIMITS
from prismstereo_hw.errors import DeviceError

__all__ = ["Link", "LinkLost", "PortError"]


class PortError(DeviceError):
    """A port that cannot be opened: it is absent, busy, or not ours to use."""


class LinkLost(DeviceError):
    """The other end went away, or fell silent."""


class Link(ABC):
    """A stream of bytes to one other end.

    One thread may read while another writes; `close` comes last. A link that was closed, or whose other end is gone,
    raises LinkLost. The links of a camera that waits for hosts (`PtyPort`, `TcpServer`) outlive the hosts.
    """

    def __init__(self, name: str, mtu: int = LIMITS.payload, bytes_per_s: float | None = None) -> None:
        self._name = name
        self._mtu = mtu
        self._bytes_per_s = bytes_per_s

    @property
    def name(self) -> str:
        """What a user calls this link: a path, or tcp:host:port."""
        return self._name

    @property
    def mtu(self) -> int:
        """The largest payload of a packet, in bytes, that keeps this link's latency low."""
        return self._mtu

    @property
    def bytes_per_s(self) -> float | None:
        """What this end writes in a second at most, to keep pace with the line; None where it does not know the line."""
        return self._bytes_per_s

    @abstractmethod
    def read(self, timeout_s: float) -> bytes:
        """Wait for at least one byte and return everything that is there; b"" when the time is over."""

    @abstractmethod
    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        """Hand over bytes and return how many were taken: all of them, or fewer when there was no room in time.

        What to do with the rest is the caller's decision: to go on, or to let it go. The reader at the other end gets
        over a packet that ends early.
        """

    @abstractmethod
    def close(self) -> None:
        """Give the port back; closing twice does no harm."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
