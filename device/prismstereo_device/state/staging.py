r"""Uploads that go on where they broke off: after a lost session, a restart, a power cut.

An upload of object N is two files: `staging/N.part` with the bytes so far, and `staging/N.marks`:

    offset  bytes
    0       4       magic "PSG\n"
    4       1       object number
    5       4       size of the whole, little-endian
    9       32      its sha256
    41      4       CRC-32C of these, little-endian
    45      4 each  CRC-32C of each block of 16 KiB of the whole, as they become complete

Nothing is synced on the way: at a restart the bytes are held as far as their marks agree with them. Only `commit` decides,
by the sha256 of the whole.
"""

from __future__ import annotations

import contextlib
import hashlib
import struct
from collections.abc import Callable
from dataclasses import dataclass

import google_crc32c

from prismstereo_device.objects import Progress, WriteStatus
from prismstereo_device.state.disk import Disk, StorageError

__all__ = ["Staging"]

_MAGIC = b"PSG\n"
_HEAD = struct.Struct("<4sBI32s")
_CRC = struct.Struct("<I")
_MARKS_AT = _HEAD.size + _CRC.size
_BLOCK = 16 << 10
_READ_BYTES = 1 << 20
_SPARE_BYTES = 1 << 20  # left free for calibrations, whatever is sent
_FOLDER = "staging"


@dataclass(slots=True)
class _Upload:
    obj: int
    size: int
    sha256: bytes
    held: int = 0
    crc: int = 0  # of the block that is not complete yet

    @property
    def part(self) -> str:
        return f"{_FOLDER}/{self.obj}.part"

    @property
    def marks(self) -> str:
        return f"{_FOLDER}/{self.obj}.marks"

    def head(self) -> bytes:
        head = _HEAD.pack(_MAGIC, self.obj, self.size, self.sha256)
        return head + _CRC.pack(google_crc32c.value(head))

    def is_of(self, size: int, sha256: bytes) -> bool:
        return (self.size, self.sha256) == (size, sha256)


class Staging:
    """At most one unfinished upload per object, on a disk. What a broken-off upload left is taken up or cleared away.

    Not for several threads at once. Nothing raises: a disk that fails is NO_ROOM.
    """

    def __init__(self, disk: Disk) -> None:
        self._disk = disk
        self._uploads: dict[int, _Upload] = {}
        self._committed: dict[int, tuple[int, bytes]] = {}
        with contextlib.suppress(OSError):
            self._take_up()

    @property
    def persistent(self) -> bool:
        """Whether an upload outlives this process."""
        return self._disk.persistent

    def begin(self, obj: int, size: int, sha256: bytes) -> Progress:
        """Begin an upload, or go on with the same one; another one of this object is forgotten."""
        upload = self._uploads.get(obj)
        if upload is not None and upload.is_of(size, sha256):
            return Progress(WriteStatus.OK, upload.held)
        self.forget(obj)
        self._committed.pop(obj, None)
        upload = _Upload(obj, size, sha256)
        try:
            if not self._has_room(size):
                free = self._disk.free()
                return Progress(WriteStatus.NO_ROOM, why=f"{size} bytes are to be stored, {free} are free: make room")
            self._disk.write(upload.part, b"")
            self._disk.write(upload.marks, upload.head())
        except OSError as error:
            return _broken(error)
        self._uploads[obj] = upload
        return Progress(WriteStatus.OK)

    def write(self, obj: int, offset: int, data: bytes) -> Progress:
        """Take bytes in order; what is held already is skipped."""
        upload = self._uploads.get(obj)
        if upload is None:
            return Progress(WriteStatus.NOT_BEGUN)
        if offset > upload.held:
            return Progress(WriteStatus.GAP, upload.held)
        if offset + len(data) > upload.size:
            why = f"bytes up to {offset + len(data)} of an object that was announced with {upload.size}"
            return Progress(WriteStatus.TOO_LARGE, upload.held, why)
        fresh = data[upload.held - offset :]
        try:
            if fresh:
                self._append(upload, fresh)
        except OSError as error:
            return _broken(error, upload.held)
        return Progress(WriteStatus.OK, upload.held)

    def commit(self, obj: int, size: int, sha256: bytes, take: Callable[[str], str | None]) -> Progress:
        """Verify the whole and hand the name of its file to `take`, which gives None or why it will not have it.

        `take` may rename the file away; what it leaves is removed. OSError or `StorageError` out of it is NO_ROOM, and the
        upload stays to be committed again. A commit that is repeated after it was done is OK again.
        """
        upload = self._uploads.get(obj)
        if upload is None or not upload.is_of(size, sha256):
            done = self._committed.get(obj) == (size, sha256)
            return Progress(WriteStatus.OK, size) if done else Progress(WriteStatus.NOT_BEGUN)
        if upload.held < size:
            return Progress(WriteStatus.GAP, upload.held)
        try:
            if self._digest(upload) != sha256:
                self.forget(obj)
                return Progress(WriteStatus.MISMATCH, why="the bytes do not have the announced sha256: send all again")
            why = take(upload.part)
        except OSError as error:
            return _broken(error, upload.held)
        except StorageError as error:
            return Progress(WriteStatus.NO_ROOM, upload.held, str(error))
        self.forget(obj)
        if why is not None:
            return Progress(WriteStatus.REFUSED, why=why)
        self._committed[obj] = (size, sha256)
        return Progress(WriteStatus.OK, size)

    def content(self, name: str) -> bytes:
        """Give the bytes of the file that `commit` hands to its taker."""
        return self._disk.read(name)

    def forget(self, obj: int) -> None:
        """Clear away an object's unfinished upload, if there is one."""
        upload = self._uploads.pop(obj, None)
        if upload is not None:
            self._clear(upload.marks, upload.part)

    def _append(self, upload: _Upload, data: bytes) -> None:
        """Store bytes, then the marks of the blocks that they complete; nothing counts as held unless all of it worked."""
        self._disk.write_at(upload.part, upload.held, data)
        held, crc, marks = upload.held, upload.crc, b""
        first_mark = _MARKS_AT + held // _BLOCK * _CRC.size
        while data:
            piece, data = data[: _BLOCK - held % _BLOCK], data[_BLOCK - held % _BLOCK :]
            crc, held = google_crc32c.extend(crc, piece), held + len(piece)
            if held % _BLOCK == 0 or held == upload.size:
                marks, crc = marks + _CRC.pack(crc), 0
        if marks:
            self._disk.write_at(upload.marks, first_mark, marks)
        upload.held, upload.crc = held, crc

    def _has_room(self, size: int) -> bool:
        """Look for room; unfinished uploads of other objects go if that is what it takes."""
        spare = _SPARE_BYTES if self._disk.persistent else 0
        for obj in [*self._uploads, None]:
            if self._disk.free() >= size + spare:
                return True
            if obj is not None:
                self.forget(obj)
        return False

    def _digest(self, upload: _Upload) -> bytes:
        digest = hashlib.sha256()
        with self._disk.open(upload.part) as file:
            while block := file.read(_READ_BYTES):
                digest.update(block)
        return digest.digest()

    def _take_up(self) -> None:
        names = self._disk.names(_FOLDER)
        for name in names:
            upload = self._resumed(name) if name.endswith(".marks") else None
            if upload is not None:
                self._uploads[upload.obj] = upload
        known = {name for upload in self._uploads.values() for name in (upload.part, upload.marks)}
        self._clear(*(name for name in names if name not in known))

    def _resumed(self, name: str) -> _Upload | None:
        """Take up an upload as far as its marks agree with its bytes; None where there is nothing to go on with."""
        try:
            content = self._disk.read(name)
            if len(content) < _MARKS_AT:
                return None
            magic, obj, size, sha256 = _HEAD.unpack_from(content)
            upload = _Upload(obj, size, sha256)
            if magic != _MAGIC or upload.marks != name or content[:_MARKS_AT] != upload.head():
                return None
            with self._disk.open(upload.part) as file:
                for (mark,) in _CRC.iter_unpack(content[_MARKS_AT : len(content) - (len(content) - _MARKS_AT) % 4]):
                    block = file.read(min(_BLOCK, size - upload.held))
                    if not block or google_crc32c.value(block) != mark:
                        break
                    upload.held += len(block)
        except OSError:
            return None
        return upload

    def _clear(self, *names: str) -> None:
        for name in names:
            with contextlib.suppress(OSError):
                self._disk.remove(name)


def _broken(error: OSError, held: int = 0) -> Progress:
    return Progress(
        WriteStatus.NO_ROOM, held, f"the camera's storage failed ({error.strerror}): make room, or replace it"
    )
