"""What the camera at the far end of the bench keeps: one setting, and objects in memory. Both count what was done to them."""

from __future__ import annotations

import hashlib
import zlib
from collections import Counter

from prismstereo_device.objects import Held, ObjectNumber, Progress, WriteStatus
from prismstereo_device.protocol.command import Command, CommandReply, CommandStatus

__all__ = ["CountingSetting", "MemoryObjects"]

_SETTING = "exposure_us"


class CountingSetting:
    """Answers `set` and `get` of the exposure, and counts how often each value was set: no request may be run twice."""

    def __init__(self) -> None:
        self._value: int = 0
        self._set = Counter[int]()

    @property
    def run_twice(self) -> int:
        """How many values were set more than once."""
        return sum(count > 1 for count in self._set.values())

    def answer(self, command: Command) -> CommandReply:
        """Run a command."""
        if command.name != _SETTING:
            return CommandReply(CommandStatus.UNKNOWN, why=f"{command.name}: this far end knows {_SETTING} alone")
        if command.verb == "set":
            if not isinstance(command.value, int):
                return CommandReply(CommandStatus.REFUSED, why=f"{_SETTING} is a whole number, not {command.value!r}")
            self._value = command.value
            self._set[command.value] += 1
        return CommandReply(CommandStatus.OK, self._value)


class MemoryObjects:
    """Takes any bytes as the update object, and gives them back as the log; implements `Objects`."""

    def __init__(self, held: bytes = b"") -> None:
        self._held = held
        self._size, self._sha256 = 0, b""
        self._staged = bytearray()
        self.commits = 0

    @property
    def held_bytes(self) -> int:
        """How much of a write is there."""
        return len(self._staged)

    def read(self, obj: int) -> Held | None:
        """Give what was committed last."""
        return Held(zlib.crc32(self._held), self._held) if obj == ObjectNumber.LOG and self._held else None

    def begin(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Begin, or go on with the same bytes."""
        if obj != ObjectNumber.UPDATE:
            return Progress(WriteStatus.NO_SUCH_OBJECT)
        if (size, sha256) != (self._size, self._sha256):
            self._size, self._sha256 = size, sha256
            self._staged.clear()
        return Progress(WriteStatus.OK, len(self._staged))

    def write(self, obj: int, offset: int, data: bytes) -> Progress:
        """Take bytes."""
        if obj != ObjectNumber.UPDATE or not self._sha256:
            return Progress(WriteStatus.NOT_BEGUN)
        held = len(self._staged)
        if offset > held:
            return Progress(WriteStatus.GAP, held)
        self._staged += data[held - offset :]
        return Progress(WriteStatus.OK, len(self._staged))

    def commit(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Verify the whole and keep it."""
        if obj == ObjectNumber.UPDATE and hashlib.sha256(self._held).digest() == sha256:
            return Progress(WriteStatus.OK, size)  # done already
        if obj != ObjectNumber.UPDATE or (size, sha256) != (self._size, self._sha256):
            return Progress(WriteStatus.NOT_BEGUN)
        if len(self._staged) != size:
            return Progress(WriteStatus.GAP, len(self._staged))
        self._sha256, staged = b"", bytes(self._staged)
        if hashlib.sha256(staged).digest() != sha256:
            return Progress(WriteStatus.MISMATCH)
        self._held = staged
        self.commits += 1
        return Progress(WriteStatus.OK, size)
