"""What stands behind a serial port's name: a wire with a speed, or something that only looks like one."""

from __future__ import annotations

import os
import re
from enum import Enum

__all__ = ["PortKind", "port_kind"]

_USB = re.compile(r"tty(ACM|GS)\d+|(cu|tty)\.usbmodem.*|rfcomm\d+")
_UART = re.compile(
    r"tty(S|AMA|USB|THS|TCU|mxc|SC|O|PS|UL|MSM|HS|LP|FIQ|AML|STM)\d+|serial\d+|(cu|tty)\.(usbserial|SLAB|wchusb).*"
)
_PTY = re.compile(r"/dev/(pts/\d+|ttys\d{3})")


class PortKind(Enum):
    """What decides how fast a port is."""

    UART = "uart"  # its baud rate
    PACKETS = (
        "packets"  # a bus that carries packets: USB CDC (a gadget's end too), Bluetooth; a baud rate means nothing
    )
    PTY = "pty"  # software; it has a baud rate only where one is asked for
    UNKNOWN = "unknown"


def port_kind(path: str) -> PortKind:
    """Tell by its name, symbolic links followed, what kind of port this is."""
    real = os.path.realpath(path) if os.name == "posix" else path
    name = real.rpartition("/")[2]
    if _PTY.fullmatch(real):
        return PortKind.PTY
    if _USB.fullmatch(name):
        return PortKind.PACKETS
    return PortKind.UART if _UART.fullmatch(name) else PortKind.UNKNOWN
