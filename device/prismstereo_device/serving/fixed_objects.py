"""Objects that never change: for a service that keeps nothing, and for tests."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

from prismstereo_device.objects import Held, Progress, WriteStatus

__all__ = ["FixedObjects"]


class FixedObjects:
    """Holds what it is made with, by number, for reading only; implements `Objects`."""

    def __init__(self, contents: Mapping[int, bytes] | None = None) -> None:
        self._held = {int(number): Held(zlib.crc32(data), data) for number, data in (contents or {}).items()}

    def read(self, obj: int) -> Held | None:
        """Give an object; None where it is not there."""
        return self._held.get(obj)

    def begin(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Refuse: nothing can be written."""
        del size, sha256
        return _refused(obj)

    def write(self, obj: int, offset: int, data: bytes) -> Progress:
        """Refuse: nothing can be written."""
        del offset, data
        return _refused(obj)

    def commit(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Refuse: nothing can be written."""
        del size, sha256
        return _refused(obj)


def _refused(obj: int) -> Progress:
    return Progress(WriteStatus.NO_SUCH_OBJECT, why=f"object {obj} cannot be written: this device keeps nothing")
