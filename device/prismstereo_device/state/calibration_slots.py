r"""The calibration on the camera: two slots that are written in turn, and a factory copy that is written once.

A slot is a file:

    offset  bytes
    0       4       magic "PSS\n"
    4       4       sequence number, little-endian; the newer of two slots is the active one; wraps
    8       4       length of the content, little-endian
    12      n       flash bytes
    12+n    4       CRC-32C of everything before, little-endian

Only the slot that is not active is ever written, so a power cut leaves the old calibration or the new one. The factory copy
has the same form. It is the first calibration that was written, takes over where no slot can be read, and is never replaced.
"""

from __future__ import annotations

import contextlib
import struct
from dataclasses import dataclass

import google_crc32c

from prismstereo_device.state.disk import Disk, StorageError
from prismstereo_device.wire import LIMITS
from prismstereo_hw.errors import DataError

__all__ = ["CalibrationSlots"]

_SLOTS = ("calibration.a", "calibration.b")
_FACTORY = "calibration.factory"
_FACTORY_NEW = "calibration.factory.new"
_MAGIC = b"PSS\n"
_HEAD = struct.Struct("<4sII")
_CRC = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class _Slot:
    sequence: int
    content: bytes

    def pack(self) -> bytes:
        body = _HEAD.pack(_MAGIC, self.sequence, len(self.content)) + self.content
        return body + _CRC.pack(google_crc32c.value(body))

    def newer_than(self, other: _Slot) -> bool:
        return 0 < (self.sequence - other.sequence) % 2**32 < 2**31


class CalibrationSlots:
    """The calibrations of one disk. What cannot be read counts as not there; nothing here looks into the bytes."""

    def __init__(self, disk: Disk) -> None:
        self._disk = disk
        self._factory = self._read(_FACTORY)
        a, b = map(self._read, _SLOTS)
        self._at = 1 if b is not None and (a is None or b.newer_than(a)) else 0
        self._active = a if self._at == 0 else b
        if self._active is None:
            self._at, self._active = 1, self._factory  # whichever: neither slot holds anything

    @property
    def active(self) -> bytes | None:
        """The flash bytes to work with; None before the first `write`."""
        return None if self._active is None else self._active.content

    @property
    def factory(self) -> bytes | None:
        """The flash bytes of the first calibration; None before the first `write`."""
        return None if self._factory is None else self._factory.content

    @property
    def persistent(self) -> bool:
        """Whether a calibration outlives this process."""
        return self._disk.persistent

    def write(self, content: bytes) -> None:
        """Make these flash bytes the active ones and verify them by reading back.

        `StorageError` when the disk fails; what was active then stays so, after a restart too.
        """
        if not 0 < len(content) <= LIMITS.calibration:
            raise DataError(f"a calibration of {len(content)} bytes: 1 to {LIMITS.calibration} can be kept")
        made_factory = False
        try:
            made_factory = self._keep_factory(content)
            self._write_slot(content)
        except OSError as error:
            if made_factory:  # the camera would start with it, though its writer was told that it failed
                self._forget_factory()
            raise StorageError(
                f"the calibration could not be stored ({error.strerror}): the one before stays"
            ) from error
        if made_factory:
            self._factory = _Slot(0, content)

    def restore(self) -> bytes:
        """Make the factory copy active again and give its bytes; `StorageError` when there is none or the disk fails."""
        if self._factory is None:
            raise StorageError("there is no factory calibration to restore: none was ever written; write one")
        self.write(self._factory.content)
        return self._factory.content

    def _write_slot(self, content: bytes) -> None:
        target = 1 - self._at  # by memory, so that an active slot that cannot be read just now is safe too
        slot = _Slot(0 if self._active is None else (self._active.sequence + 1) % 2**32, content)
        try:
            self._write_verified(_SLOTS[target], slot)
        except OSError:
            with contextlib.suppress(OSError):  # a write that failed must not come to life at the next start
                self._disk.write(_SLOTS[target], b"")
                self._disk.sync(_SLOTS[target])
            raise
        self._at, self._active = target, slot

    def _write_verified(self, name: str, slot: _Slot) -> None:
        self._disk.write(name, slot.pack())
        self._disk.sync(name)
        self._disk.sync_folder()
        if self._disk.read(name) != slot.pack():
            raise OSError(0, "the disk gives back other bytes than were written")

    def _keep_factory(self, content: bytes) -> bool:
        """Write the factory copy unless there is one, readable or not; tell whether it was written."""
        if _FACTORY in self._disk.names():
            self._factory = self._factory or self._read(_FACTORY)  # left by a first write that failed on a dying disk
            return False
        self._write_verified(_FACTORY_NEW, _Slot(0, content))
        try:
            self._disk.rename(_FACTORY_NEW, _FACTORY)
            self._disk.sync_folder()
        except OSError:
            self._forget_factory()
            raise
        return True

    def _forget_factory(self) -> None:
        with contextlib.suppress(OSError):
            self._disk.remove(_FACTORY)
            self._disk.sync_folder()

    def _read(self, name: str) -> _Slot | None:
        try:
            data = self._disk.read(name)
        except OSError:
            return None
        if len(data) < _HEAD.size + _CRC.size:
            return None
        magic, sequence, length = _HEAD.unpack_from(data)
        (crc,) = _CRC.unpack_from(data, len(data) - _CRC.size)
        whole = len(data) == _HEAD.size + length + _CRC.size
        if magic != _MAGIC or not whole or crc != google_crc32c.value(data[: -_CRC.size]):
            return None
        return _Slot(sequence, data[_HEAD.size : -_CRC.size])
