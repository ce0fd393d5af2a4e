"""Whoever lives on a connection: what it is told, and when it may speak."""

from __future__ import annotations

from typing import Protocol

from prismstereo.events import CameraEvent
from prismstereo_device.framing import Packet
from prismstereo_hw.errors import DeviceError

__all__ = ["Listener"]


class Listener(Protocol):
    """Whoever lives on a connection. `beat` is called in a thread of its own, the rest in the reading one."""

    def hear(self, packet: Packet, heard_us: int) -> None:
        """Take a packet of the session, and the host's clock when it came."""

    def begin_session(self, session: int, *, same_boot: bool) -> None:
        """Forget what belonged to the session before; `same_boot`: the device was there all the time."""

    def tell(self, event: CameraEvent) -> None:
        """Hear what has happened."""

    def lose(self, error: DeviceError) -> None:
        """Hear that the sensor is lost for good."""

    def beat(self, now_s: float) -> float:
        """Send what is due, and say when to come again; at least every 100 ms."""
        ...
