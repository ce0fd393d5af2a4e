"""Disks under a recording that fail as disks do: the power goes, or there is no room."""

from __future__ import annotations

import errno
import random

BLOCK = 4096


class ModelDisk:
    """A file in memory with room for `room` bytes. A write that does not fit is done in part, and fails."""

    def __init__(self, room: int = 1 << 40, *, free: int = 1 << 40) -> None:
        self.content = bytearray()
        self.safe_bytes = 0
        self.closed = False
        self.free = free
        self._room = room

    def append(self, data: bytes) -> None:
        fits = max(0, self._room - len(self.content))
        self.content += data[:fits]
        if fits < len(data):
            raise OSError(errno.ENOSPC, "No space left on device")

    def cut(self, size: int) -> None:
        del self.content[size:]

    def sync(self) -> None:
        self.safe_bytes = len(self.content)

    def space(self) -> tuple[int, int]:
        return self.free, 1 << 40

    def close(self) -> None:
        self.closed = True

    def after_a_cut(self, rng: random.Random) -> bytes:
        """Give what the next start finds: of what was not synced each block is there or zero, and the size is any between."""
        size = rng.randint(self.safe_bytes, len(self.content))
        left = self.content[:size]
        for start in range(self.safe_bytes - self.safe_bytes % BLOCK, size, BLOCK):
            begin, stop = max(start, self.safe_bytes), min(start + BLOCK, size)
            if rng.random() < 0.5:
                left[begin:stop] = bytes(stop - begin)
        return bytes(left)
