"""A serial port: UART, USB CDC, or the far end of a pseudo-terminal."""

from __future__ import annotations

import contextlib
import errno
import os
from typing import Any

from prismstereo_device.link.base import Link, LinkLost, PortError
from prismstereo_device.link.descriptor import write_some

__all__ = ["DEFAULT_BAUD", "SerialPort", "mtu_for_baud"]

DEFAULT_BAUD = 921_600  # USB CDC ignores it
_MTU_UP_TO_BAUD = ((230_400, 240), (1_000_000, 512), (3_000_000, 1024))
_MTU_BEYOND = 4096
_WRITE_PIECE = 256  # where the system does not tell how much of a write it took


def mtu_for_baud(baud: int) -> int:
    """Give the payload that keeps a packet below some 20 ms on the line."""
    return next((mtu for limit, mtu in _MTU_UP_TO_BAUD if baud <= limit), _MTU_BEYOND)


class SerialPort(Link):
    """A serial port, for this process alone; what came in before it was opened is thrown away.

    Raises PortError where it cannot be opened, LinkLost when it goes away (a cable is pulled).
    """

    def __init__(self, path: str, baud: int = DEFAULT_BAUD) -> None:
        super().__init__(path, mtu_for_baud(baud))
        self._port = _open(path, baud)

    def read(self, timeout_s: float) -> bytes:
        """Wait for at least one byte and return everything that is there; b"" when the time is over."""
        import serial

        try:
            waiting = self._port.in_waiting
            if not waiting:
                if self._port.timeout != timeout_s:
                    self._port.timeout = timeout_s
                first: bytes = self._port.read(1)
                waiting = self._port.in_waiting if first else 0
                return first + self._port.read(waiting) if waiting else first
            return bytes(self._port.read(waiting))
        except (serial.SerialException, OSError, TypeError) as error:  # TypeError: pyserial's descriptor after close
            raise self._lost(error) from error

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        """Hand over bytes; returns how many were taken in time."""
        import serial

        try:
            if os.name == "posix":
                return write_some(self._port.fileno(), data, timeout_s)
            return write_in_pieces(self._port, data, timeout_s)
        except (serial.SerialException, OSError) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Give the port back."""
        with contextlib.suppress(OSError):  # a port that was pulled out cannot be closed well
            self._port.close()

    def _lost(self, error: Exception) -> LinkLost:
        return LinkLost(f"the serial port {self.name} went away ({error}): check the cable, then open it again")


def write_in_pieces(port: Any, data: bytes, timeout_s: float) -> int:
    """Write through pyserial alone, piece by piece: it does not tell how much it took before its time was over."""
    import serial

    port.write_timeout = timeout_s
    for begin in range(0, len(data), _WRITE_PIECE):
        try:
            port.write(data[begin : begin + _WRITE_PIECE])
        except serial.SerialTimeoutException:
            return begin
    return len(data)


def _open(path: str, baud: int) -> Any:
    import serial

    try:
        port = serial.Serial(path, baud, timeout=0.1, write_timeout=1.0, exclusive=True)
        port.reset_input_buffer()
    except (serial.SerialException, OSError, ValueError) as error:
        raise PortError(f"the serial port {path} cannot be opened, {_reason(error)}: {_ports_here()}") from error
    with contextlib.suppress(AttributeError, NotImplementedError, ValueError, OSError):  # not every port has the mode
        port.set_low_latency_mode(low_latency_settings=True)
    return port


def _reason(error: Exception) -> str:
    match getattr(error, "errno", None):
        case errno.ENOENT:
            return "it is not there"
        case errno.EAGAIN | errno.EBUSY:
            return "another program has it open"
        case errno.EACCES | errno.EPERM:
            return "this user may not (join the group that owns it, often dialout)"
    return str(error)


def _ports_here() -> str:
    from serial.tools import list_ports

    names = sorted(port.device for port in list_ports.comports())
    if names:
        return f"the ports of this computer are {', '.join(names)}"
    return "this computer has no serial port; plug the sensor in, or give tcp:HOST:PORT"
