"""A serial port: UART, USB CDC, or the far end of a pseudo-terminal."""

from __future__ import annotations

import contextlib
import errno
import os
import time
from typing import Any

from prismstereo_device.link.base import Link, LinkLost, PortError
from prismstereo_device.link.descriptor import read_some, write_some
from prismstereo_device.link.pacing import Pacer, line_bytes_per_s, packet_bytes
from prismstereo_device.link.port_kind import PortKind, port_kind
from prismstereo_device.wire import LIMITS

__all__ = ["DEFAULT_BAUD", "SerialPort", "mtu_for_baud"]

DEFAULT_BAUD = 921_600  # of a UART; other kinds of port ignore it
_MTU_UP_TO_BAUD = ((230_400, 240), (1_000_000, 512), (3_000_000, 1024))
_WRITE_PIECE = 256  # where the system does not tell how much of a write it took
_HANDSHAKE_ABOVE_BAUD = 1_000_000  # faster than this, a receiver's few bytes of buffer overrun
_LAST_WORDS_S = 0.2  # what is still on its way when a port is closed has this long


def mtu_for_baud(baud: int) -> int:
    """Give the payload that keeps a packet below some 20 ms on the line."""
    return next((mtu for limit, mtu in _MTU_UP_TO_BAUD if baud <= limit), LIMITS.payload)


class SerialPort(Link):
    """A serial port, for this process alone; what came in before it was opened is thrown away.

    A UART is written to no faster than its `baud` carries, so that at most two packets wait in the system; so is any
    other port for which a `baud` is given, except USB CDC and Bluetooth, which have none. `rtscts` turns the RTS/CTS
    handshake on or off; None turns it on for a UART above 1 Mbaud whose CTS line is up.

    Raises PortError where it cannot be opened, LinkLost when it goes away (a cable is pulled).
    """

    def __init__(self, path: str, baud: int | None = None, *, rtscts: bool | None = None) -> None:
        kind = port_kind(path)
        baud_counts = kind is not PortKind.PACKETS and (baud is not None or kind in (PortKind.UART, PortKind.UNKNOWN))
        speed = DEFAULT_BAUD if baud is None else baud
        paced = baud_counts and (baud is not None or kind is PortKind.UART)
        mtu = mtu_for_baud(speed) if baud_counts else LIMITS.payload
        super().__init__(path, mtu, line_bytes_per_s(speed) if paced else None)
        self._port = _open(path, speed, rtscts=_handshake(kind, speed, rtscts))
        self._pacer = Pacer(self.bytes_per_s, packet_bytes(mtu), queued=self._queued)

    def read(self, timeout_s: float) -> bytes:
        """Wait for at least one byte and return everything that is there; b"" when the time is over."""
        try:
            if os.name == "posix":
                return read_some(self._port.fileno(), timeout_s)
            return read_what_waits(self._port, timeout_s)
        except _port_errors() as error:
            raise self._lost(error) from error

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        """Hand over bytes as the line gets free for them; returns how many were taken in time."""
        try:
            return self._pacer.write(data, timeout_s, self._take)
        except _port_errors() as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Give the port back; what a halted line does not take within 0.2 s is thrown away."""
        with contextlib.suppress(*_port_errors()):  # a port that was pulled out cannot be closed well
            until_s = time.monotonic() + _LAST_WORDS_S
            while self._port.is_open and self._port.out_waiting:
                if time.monotonic() >= until_s:
                    self._port.reset_output_buffer()  # else the system would wait for the line, for half a minute
                    break
                time.sleep(_LAST_WORDS_S / 40)
        with contextlib.suppress(*_port_errors()):
            self._port.close()

    def _take(self, part: bytes, timeout_s: float) -> int:
        if os.name == "posix":
            return write_some(self._port.fileno(), part, timeout_s)
        return write_in_pieces(self._port, part, timeout_s)

    def _queued(self) -> int:
        """Say how many bytes the driver holds; 0 where it does not tell, as a pseudo-terminal."""
        waiting: int = self._port.out_waiting
        return waiting

    def _lost(self, error: Exception) -> LinkLost:
        return LinkLost(f"the serial port {self.name} went away ({error}): check the cable, then open it again")


def read_what_waits(port: Any, timeout_s: float) -> bytes:
    """Read through pyserial alone: all that is there, or else whatever comes first; b"" when the time is over."""
    waiting = port.in_waiting
    if not waiting:
        if port.timeout != timeout_s:
            port.timeout = timeout_s
        first: bytes = port.read(1)
        waiting = port.in_waiting if first else 0
        return first + port.read(waiting) if waiting else first
    return bytes(port.read(waiting))


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


def _handshake(kind: PortKind, baud: int, wish: bool | None) -> bool | None:
    """Say whether RTS/CTS is on; None: if its line is up."""
    if wish is None and kind is PortKind.UART and baud > _HANDSHAKE_ABOVE_BAUD:
        return None
    return bool(wish)


def _open(path: str, baud: int, *, rtscts: bool | None) -> Any:
    import serial

    try:
        port = serial.Serial(path, baud, timeout=0.1, write_timeout=1.0, exclusive=True, rtscts=bool(rtscts))
        try:
            port.reset_input_buffer()
            if rtscts is None and port.cts:
                port.rtscts = True
        except BaseException:
            port.close()
            raise
    except _port_errors() as error:
        raise PortError(f"the serial port {path} cannot be opened, {_reason(error)}: {_ports_here()}") from error
    with contextlib.suppress(AttributeError, NotImplementedError, ValueError, OSError):  # not every port has the mode
        port.set_low_latency_mode(low_latency_settings=True)
    return port


def _port_errors() -> tuple[type[Exception], ...]:
    """Name what a port raises when it is not there, or no longer: pyserial lets its system's own errors through."""
    import serial

    errors: tuple[type[Exception], ...] = (serial.SerialException, OSError, TypeError, ValueError)
    with contextlib.suppress(ImportError):  # not a POSIX system
        import termios

        errors += (termios.error,)
    return errors


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
