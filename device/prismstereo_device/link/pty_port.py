"""The camera's end of a pseudo-terminal: a serial port made of software, which any host can open by its path."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from prismstereo_device.link.base import Link, LinkLost, PortError
from prismstereo_device.link.descriptor import read_some, write_some
from prismstereo_device.link.pacing import Pacer, line_bytes_per_s, packet_bytes
from prismstereo_device.link.serial_port import mtu_for_baud
from prismstereo_device.wire import LIMITS

__all__ = ["PtyPort"]


class PtyPort(Link):
    """A new pseudo-terminal in raw mode; `name` is the path for the host, `link_path` an optional symbolic link to it.

    With a `baud` it is written to as a UART of that speed is, in packets of the length that suits it, unless `mtu` says
    otherwise. Hosts come and go: the host's end is kept open here too, so that reading never fails because nobody is
    there. Nobody there also means that the line fills up (some kilobytes) and `write` takes less. Raises PortError where
    no terminal is to be had (not a POSIX system), or where something other than a symbolic link is at `link_path`.
    """

    def __init__(self, link_path: Path | None = None, mtu: int | None = None, *, baud: int | None = None) -> None:
        self._device, self._host = _open_raw()
        suitable = LIMITS.payload if baud is None else mtu_for_baud(baud)
        pace = None if baud is None else line_bytes_per_s(baud)
        super().__init__(os.ttyname(self._host), suitable if mtu is None else mtu, pace)
        self._pacer = None if pace is None else Pacer(pace, packet_bytes(self.mtu))
        self._link_path = link_path
        if link_path is not None:
            try:
                _point(link_path, self.name)
            except PortError:
                self._link_path = None
                self.close()
                raise

    def read(self, timeout_s: float) -> bytes:
        """Wait for at least one byte and return everything that is there; b"" when the time is over."""
        try:
            return read_some(self._device, timeout_s)
        except (OSError, ValueError) as error:
            raise self._lost(error) from error

    def write(self, data: bytes, timeout_s: float = 1.0) -> int:
        """Hand over bytes; returns how many were taken in time."""
        try:
            if self._pacer is not None:
                return self._pacer.write(data, timeout_s, self._take)
            return self._take(data, timeout_s)
        except (OSError, ValueError) as error:
            raise self._lost(error) from error

    def fileno(self) -> int:
        """Give the camera's descriptor, which never blocks, to wait on several at once; -1 after `close`."""
        return self._device

    def close(self) -> None:
        """End the terminal, as if the cable were pulled, and remove the symbolic link if it is still ours."""
        for descriptor in (self._device, self._host):
            if descriptor >= 0:
                os.close(descriptor)
        self._device = self._host = -1
        if self._link_path is not None:
            with contextlib.suppress(OSError):
                if self._link_path.readlink() == Path(self.name):
                    self._link_path.unlink()

    def _take(self, data: bytes, timeout_s: float) -> int:
        return write_some(self._device, data, timeout_s)

    def _lost(self, error: Exception) -> LinkLost:
        return LinkLost(f"the pseudo-terminal {self.name} is closed ({error})")


def _open_raw() -> tuple[int, int]:
    try:
        import pty
        import tty
    except ImportError as error:
        raise PortError("this system has no pseudo-terminals: serve on tcp:HOST:PORT") from error
    try:
        device, host = pty.openpty()
    except OSError as error:
        raise PortError(f"no pseudo-terminal is left ({error}): close some, or serve on tcp:HOST:PORT") from error
    tty.setraw(host)
    os.set_blocking(device, False)
    return device, host


def _point(link_path: Path, target: str) -> None:
    """Make `link_path` a symbolic link to the terminal, in place of an older symbolic link."""
    if link_path.exists() and not link_path.is_symlink():
        raise PortError(f"{link_path} is in the way of the port's symbolic link: give another path, or remove it")
    try:
        link_path.unlink(missing_ok=True)
        link_path.symlink_to(target)
    except OSError as error:
        raise PortError(f"{link_path} cannot be made a symbolic link to {target} ({error})") from error
