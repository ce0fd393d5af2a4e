"""The last lines of the log, for a host that asks what happened."""

from __future__ import annotations

import logging
from collections import deque

__all__ = ["LogRing"]

_MOST_BYTES = 64 * 1024
_LONGEST_LINE = 2048


class LogRing(logging.Handler):
    """Keeps the newest lines, `most_bytes` of them at most, and the last error. Give it to `logger.addHandler`."""

    def __init__(self, most_bytes: int = _MOST_BYTES, level: int = logging.INFO) -> None:
        super().__init__(level)
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        self._most_bytes = most_bytes
        self._lines: deque[bytes] = deque()
        self._bytes = 0
        self._last_error = ""

    @property
    def last_error(self) -> str:
        """The text of the last record of level ERROR or above, one line; empty where there was none."""
        return self._last_error

    def content(self) -> bytes:
        """Give the lines, oldest first, UTF-8."""
        self.acquire()
        try:
            return b"".join(self._lines)
        finally:
            self.release()

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record as one line; the exception behind it, if there is one, by its own sentence."""
        try:
            message = " ".join(record.getMessage().split())
        except (TypeError, ValueError):  # a record whose arguments do not fit its text
            self.handleError(record)
            return
        if record.exc_info and record.exc_info[1] is not None:
            message = f"{message}: {' '.join(str(record.exc_info[1]).split())}"
        if record.levelno >= logging.ERROR:
            self._last_error = message
        plain = logging.LogRecord(record.name, record.levelno, record.pathname, record.lineno, message, None, None)
        plain.created, plain.msecs = record.created, record.msecs
        line = self.format(plain).encode(errors="replace")[: _LONGEST_LINE - 1] + b"\n"
        self._lines.append(line)
        self._bytes += len(line)
        while self._bytes > self._most_bytes and self._lines:
            self._bytes -= len(self._lines.popleft())
