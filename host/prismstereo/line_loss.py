"""What share of the device's packets lately came damaged, or not at all."""

from __future__ import annotations

from collections import deque

from prismstereo_device.framing import Packet

__all__ = ["LineLoss"]

_SPAN_S = 3.0
_FEW = 20  # packets tell nothing of a line
_SEQ = 0xFFFF
_HALF_RANGE = 1 << 15


class LineLoss:
    """Counts gaps in the packets' numbers, channel by channel, and damaged packets, over the last three seconds.

    A damaged packet is a gap as well, seen when the next one of its channel arrives; so the larger of the two counts.
    """

    def __init__(self) -> None:
        self._due: dict[int, int] = {}
        self._good = self._missing = self._bad = 0
        self._marks: deque[tuple[float, int, int, int]] = deque()

    def begin_session(self) -> None:
        """Expect every channel to count from its beginning."""
        self._due.clear()

    def count(self, packet: Packet) -> None:
        """Count a good packet and the gap before it; a repeated or overtaken number is no gap."""
        gap = (packet.seq - self._due.get(packet.channel, 0)) & _SEQ
        if gap < _HALF_RANGE:
            self._missing += gap
            self._due[packet.channel] = (packet.seq + 1) & _SEQ
        self._good += 1

    def permille(self, bad: int, now_s: float) -> int:
        """Give the share, 0 to 1000; `bad` is how many damaged packets there were since the beginning."""
        self._bad = bad
        if not self._marks or now_s - self._marks[-1][0] > _SPAN_S / 10:
            self._marks.append((now_s, self._good, self._missing, self._bad))
        while len(self._marks) > 1 and now_s - self._marks[1][0] >= _SPAN_S:
            self._marks.popleft()
        _, good, missing, bad = self._marks[0]
        lost = max(self._missing - missing, self._bad - bad)
        packets = lost + self._good - good
        return round(1000 * lost / packets) if packets >= _FEW else 0
