"""A clock of bytes: what is written to a slow line stands in no queue of the system, where nothing can overtake it.

A serial driver takes kilobytes at once and sends them for as long as they last: 4096 bytes are 0.36 s at 115200 baud, and
an answer to a command would wait behind them. So a packet is handed over only when the line is about to be free.
"""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["Pacer", "line_bytes_per_s", "packet_bytes"]

_BITS_PER_BYTE = 10  # start bit, eight bits, stop bit
_SHARE = 0.97  # clocks of two ends differ, and a line that is never quite full has no queue
_PACKETS_AHEAD = 2
_SHORTEST_WAIT_S = 0.0005
_HEADER_AND_CRC = 11
_COBS_RUN = 254  # one more byte for each run of so many, one for the last, and the 0x00 at the end


def line_bytes_per_s(baud: int) -> float:
    """Give the bytes per second that are written to an asynchronous serial line of this speed."""
    return _SHARE * baud / _BITS_PER_BYTE


def packet_bytes(mtu: int) -> int:
    """Give the bytes on the line of a packet whose payload is this long, at most."""
    body = mtu + _HEADER_AND_CRC
    return body + body // _COBS_RUN + 2


class Pacer:
    """Lets bytes through at `bytes_per_s` (None: at once), never more than two packets ahead of the line.

    `packet_bytes` is the longest packet as encoded. `queued` tells how many bytes the system still holds, where it can
    tell: the line may be slower than its clock, or halted by the other end. For one writing thread at a time.
    """

    def __init__(
        self,
        bytes_per_s: float | None,
        packet_bytes: int,
        *,
        queued: Callable[[], int] = lambda: 0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._bytes_per_s = bytes_per_s
        self._packet_bytes = packet_bytes
        self._queued = queued
        self._clock = clock
        self._sleep = sleep
        self._free_at_s = clock()

    def write(self, data: bytes, timeout_s: float, take: Callable[[bytes, float], int]) -> int:
        """Hand `data` to `take(part, timeout_s)` as the line gets free; return how many bytes were taken in time."""
        until_s = self._clock() + timeout_s
        taken = 0
        while taken < len(data):
            part = data[taken : taken + self._packet_bytes]
            if not self._wait(len(part), until_s):
                break
            count = take(part, max(0.0, until_s - self._clock()))
            self._note(count)
            taken += count
            if count < len(part):
                break
        return taken

    def _wait(self, count: int, until_s: float) -> bool:
        """Sleep until `count` bytes may go; whether that is before the time is over."""
        while (wait_s := self._wait_s(count)) > 0:
            left_s = until_s - self._clock()
            if left_s <= 0:
                return False
            self._sleep(min(left_s, max(wait_s, _SHORTEST_WAIT_S)))
        return True

    def _wait_s(self, count: int) -> float:
        """Say how long it takes until these bytes stand at most two packets deep, as far as is known."""
        room = _PACKETS_AHEAD * self._packet_bytes - count
        too_many = self._queued() - room
        if self._bytes_per_s is None:
            return _SHORTEST_WAIT_S if too_many > 0 else 0.0
        ahead_s = self._free_at_s - self._clock() - room / self._bytes_per_s
        return max(ahead_s, too_many / self._bytes_per_s)

    def _note(self, count: int) -> None:
        if self._bytes_per_s is not None:
            self._free_at_s = max(self._free_at_s, self._clock()) + count / self._bytes_per_s
