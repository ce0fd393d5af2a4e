"""Links: how the bytes get from the camera to the desk, behind one small face."""

from __future__ import annotations

from prismstereo_device.link.base import Link, LinkLost, PortError

__all__ = ["Link", "LinkLost", "PortError", "open_link"]


def open_link(port: str, *, baud: int | None = None, timeout_s: float = 5.0, rtscts: bool | None = None) -> Link:
    """Open the host's end: a serial port (`/dev/ttyACM0`, `COM3`), or `tcp:HOST:PORT` (also with `//`).

    `baud` matters to a real UART alone (default 921600), and so does `rtscts`, its handshake: on, off, or, with None, on
    above 1 Mbaud where the other end is seen to take part. Raises PortError where there is nothing to open.
    """
    if port.lower().startswith("tcp:"):
        from prismstereo_device.link.tcp import TcpClient

        host, number = _address(port)
        return TcpClient(host, number, timeout_s)
    from prismstereo_device.link.serial_port import SerialPort

    return SerialPort(port, baud, rtscts=rtscts)


def _address(url: str) -> tuple[str, int]:
    host, _, number = url[len("tcp:") :].removeprefix("//").rstrip("/").rpartition(":")
    host = host.removeprefix("[").removesuffix("]")  # an IPv6 address
    if not host or not (number.isascii() and number.isdigit()) or not 0 < int(number) < 65536:
        raise PortError(f"{url!r} is no address: write tcp:HOST:PORT, with a port from 1 to 65535")
    return host, int(number)
