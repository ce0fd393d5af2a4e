"""The objects that a host reads and writes by number, and what keeps them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

__all__ = ["Held", "ObjectNumber", "Objects", "Progress", "WriteStatus"]


class ObjectNumber(IntEnum):
    """What the device keeps for a host."""

    CALIBRATION = 1  # flash bytes of the active calibration; writing it makes the written one active
    STILL = 2  # the last still, a PNG or JPEG file
    LOG = 3  # the last lines of the log, UTF-8
    UPDATE = 4  # a signed bundle, write only
    FACTORY_CALIBRATION = 5  # flash bytes of the first calibration that was ever written, read only
    IDENTITY = 6  # JSON: who this is, what it can do, its modes
    SELF_TEST = 7  # JSON: findings of the last self-test
    OPTICS = 8  # JSON: findings about lens, mirrors and prism


class WriteStatus(IntEnum):
    """How a step of a write ended."""

    OK = 0
    NO_SUCH_OBJECT = 1  # it is not there, or may not be written
    TOO_LARGE = 2
    GAP = 3  # bytes before these are missing: go on at the offset that is held
    NOT_BEGUN = 4  # no write of this object and sha256 is under way: begin again
    MISMATCH = 5  # the bytes do not have the announced sha256: all of it has to be sent again
    REFUSED = 6  # whole, but not what this object may be: the text says why; what was active stays active
    NO_ROOM = 7  # the device's storage is full or broken


@dataclass(frozen=True, slots=True)
class Held:
    """An object's content; `version` (32 bits) changes whenever the content does."""

    version: int
    content: bytes


@dataclass(frozen=True, slots=True)
class Progress:
    """How a step of a write ended, how many bytes from the start are held, and why it was refused."""

    status: WriteStatus
    held: int = 0
    why: str = ""


class Objects(Protocol):
    """A shelf of objects by number. Calls return within some milliseconds, `commit` within a second; none raises."""

    def read(self, obj: int) -> Held | None:
        """Give an object; None where it is not there or may not be read."""
        ...

    def begin(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Begin to write, or go on with what was begun with the same size and sha256: `held` says from where."""
        ...

    def write(self, obj: int, offset: int, data: bytes) -> Progress:
        """Take bytes; what is already held is skipped, a gap is refused."""
        ...

    def commit(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Verify the whole and make it the object, or leave everything as it was."""
        ...
