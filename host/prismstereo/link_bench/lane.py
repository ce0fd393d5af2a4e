"""One direction of a bad line: a short buffer, a speed, and damage on the way out."""

from __future__ import annotations

from collections import deque

from prismstereo.link_bench.damage import Damage
from prismstereo.link_bench.fault_plan import Faults

__all__ = ["Lane"]

_CAPACITY = 4096
_GRAIN_S = 0.004  # a slow line hands on what it carries in so long
_LEAST_GRAIN = 64
_LATE_S = 0.01  # a relay that was not scheduled for so long makes up for it


class Lane:
    """Bytes on their way. Times are seconds since the line was set up."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults = faults
        self._damage = Damage(faults, seed)
        self._waiting: deque[tuple[float, bytes]] = deque()  # when the last byte of a run comes out
        self._waiting_bytes = 0
        self._free_at_s = 0.0
        self._out = bytearray()
        self.carried_bytes = 0

    @property
    def room(self) -> int:
        """How many bytes may be put in at once, now."""
        room = _CAPACITY - self._waiting_bytes - len(self._out)
        if self._faults.slow is not None:
            room = min(room, max(_LEAST_GRAIN, int(self._faults.slow * _GRAIN_S)))
        return max(0, room)

    def put(self, data: bytes, now_s: float) -> None:
        """Take bytes in."""
        due_s = now_s
        if self._faults.slow is not None:
            due_s = max(now_s - _LATE_S, self._free_at_s) + len(data) / self._faults.slow
            self._free_at_s = due_s
        self._waiting.append((due_s, data))
        self._waiting_bytes += len(data)

    def halted(self, now_s: float) -> bool:
        """Whether nothing moves."""
        return self._faults.stall is not None and self._faults.stall.active(now_s)

    def out(self, now_s: float) -> bytes:
        """Give what has come out and was not taken yet."""
        while self._waiting and self._waiting[0][0] <= now_s and not self.halted(now_s):
            _, data = self._waiting.popleft()
            self._waiting_bytes -= len(data)
            self._out += self._damage.apply(data, now_s)
        return b"" if self.halted(now_s) else bytes(self._out)

    def taken(self, count: int) -> None:
        """Note that so many bytes of `out` were taken."""
        del self._out[:count]
        self.carried_bytes += count

    def due_in_s(self, now_s: float) -> float | None:
        """Say when the next bytes come out; None where none are on their way."""
        return max(0.0, self._waiting[0][0] - now_s) if self._waiting else None
