"""Reading and writing a POSIX file descriptor (a terminal) with a time limit."""

from __future__ import annotations

import errno
import os
import select
import time

__all__ = ["read_some", "write_some"]

_MOST = 65536


def read_some(descriptor: int, timeout_s: float) -> bytes:
    """Wait for bytes and return what is there, at most 64 KiB; b"" when the time is over.

    Raises OSError, also where the other end hung up: a terminal then is ready to be read and holds nothing.
    """
    ready, _, _ = select.select([descriptor], [], [], timeout_s)
    if not ready:
        return b""
    try:
        data = os.read(descriptor, _MOST)
    except BlockingIOError:
        return b""
    if not data:
        raise OSError(errno.EIO, "the other end hung up")
    return data


def write_some(descriptor: int, data: bytes, timeout_s: float) -> int:
    """Write until all is taken or the time is over, and return how much was; the descriptor must be non-blocking.

    Raises OSError.
    """
    deadline = time.monotonic() + timeout_s
    rest = memoryview(data)
    while rest:
        try:
            rest = rest[os.write(descriptor, rest) :]
        except BlockingIOError:
            left = deadline - time.monotonic()
            if left <= 0:
                break
            select.select([], [descriptor], [], left)
    return len(data) - len(rest)
