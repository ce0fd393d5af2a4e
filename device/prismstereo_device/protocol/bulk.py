"""Objects by offset, read and written in parts: a lost request or answer is simply sent again.

A write begins with the whole's size and SHA-256, sends parts in order, and commits; until it is committed whole and verified,
nothing has changed. What was begun with the same size and SHA-256 goes on where it stopped.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Self

from prismstereo_device.objects import WriteStatus
from prismstereo_device.protocol.body import cut_text, read_fields
from prismstereo_device.wire import LIMITS, WireError

__all__ = [
    "BulkRequest",
    "ReadReply",
    "ReadRequest",
    "ReadStatus",
    "WriteBegin",
    "WriteCommit",
    "WritePart",
    "WriteReply",
    "answer_read",
    "read_bulk_reply",
    "read_bulk_request",
]

_READ = 1  # kind of a read request and of its answer
_BEGIN, _PART, _COMMIT = 2, 3, 4  # kinds of the three steps of a write
_WRITTEN = 2  # kind of the answer to each of them
_SHA256 = 32
_NAME = 4  # bytes of the sha256 that name a transfer in each of its parts
_WHY_BYTES = 100  # the answer fits the smallest packet


class ReadStatus(IntEnum):
    """How a read ended."""

    OK = 0
    NO_SUCH_OBJECT = 1
    CHANGED = 2  # the asked version is no longer there: begin again
    BEYOND_END = 3


@dataclass(frozen=True, slots=True)
class ReadRequest:
    """Ask for up to `length` bytes of an object from `offset`; version 0 is whichever is there."""

    obj: int
    version: int
    offset: int
    length: int

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBIII")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        return self._LAYOUT.pack(_READ, self.obj, self.version, self.offset, self.length)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a request; raises WireError."""
        return cls(*_fields(cls._LAYOUT, body, _READ, "a read request"))


@dataclass(frozen=True, slots=True)
class ReadReply:
    """A part of an object: its version, its whole size, and the bytes from `offset`; none where `status` is not OK."""

    status: ReadStatus
    obj: int
    version: int
    total: int
    offset: int
    data: bytes

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBBIII")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        return self._LAYOUT.pack(_READ, self.status, self.obj, self.version, self.total, self.offset) + self.data

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read an answer; raises WireError where it is cut, of an unknown kind, or its part lies outside its object."""
        kind, status, obj, version, total, offset = read_fields(cls._LAYOUT, body, "a bulk reply")
        data = body[cls._LAYOUT.size :]
        if kind != _READ or status > max(ReadStatus):
            raise WireError(f"a bulk reply of kind {kind}, status {status}: kind 1, status 0 to {max(ReadStatus)}")
        if total > LIMITS.object or (status == ReadStatus.OK and offset + len(data) > total):
            raise WireError(
                f"bytes {offset} to {offset + len(data)} of an object of {total}: "
                f"a part lies within its object, and that within {LIMITS.object}"
            )
        return cls(ReadStatus(status), obj, version, total, offset, data)


@dataclass(frozen=True, slots=True)
class _Whole:
    """A whole object to be written: its size in bytes and its SHA-256 (32 bytes)."""

    obj: int
    size: int
    sha256: bytes

    KIND: ClassVar[int]
    _LAYOUT: ClassVar[struct.Struct] = struct.Struct(f"<BBI{_SHA256}s")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        return self._LAYOUT.pack(self.KIND, self.obj, self.size, self.sha256)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a request, whatever its size; raises WireError."""
        return cls(*_fields(cls._LAYOUT, body, cls.KIND, "a request to begin or commit a write"))


@dataclass(frozen=True, slots=True)
class WriteBegin(_Whole):
    """Begin to write an object of `size` bytes with this SHA-256 (32 bytes), or ask how far that write has come."""

    KIND: ClassVar[int] = _BEGIN


@dataclass(frozen=True, slots=True)
class WriteCommit(_Whole):
    """Say that all parts were sent: verify the whole, make it the object, or leave everything as it was."""

    KIND: ClassVar[int] = _COMMIT


@dataclass(frozen=True, slots=True)
class WritePart:
    """Bytes from `offset` of the write whose SHA-256 begins with `sha256_start` (4 bytes); at least one byte."""

    obj: int
    sha256_start: bytes
    offset: int
    data: bytes

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct(f"<BB{_NAME}sI")

    def pack(self) -> bytes:
        """Give the body's bytes; a longer `sha256_start` is cut."""
        return self._LAYOUT.pack(_PART, self.obj, self.sha256_start, self.offset) + self.data

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a part; raises WireError where it has no bytes or lies beyond the largest object."""
        obj, name, offset = _fields(cls._LAYOUT, body, _PART, "a part of a write")
        data = body[cls._LAYOUT.size :]
        if not data or offset + len(data) > LIMITS.object:
            raise WireError(
                f"bytes {offset} to {offset + len(data)} to write: a part has some, and lies within {LIMITS.object}"
            )
        return cls(obj, name, offset, data)

    @classmethod
    def room(cls, mtu: int) -> int:
        """Give how many bytes of data fit one part."""
        return mtu - cls._LAYOUT.size


@dataclass(frozen=True, slots=True)
class WriteReply:
    """How a step of a write ended, how many bytes from the start the device holds, and why it refused."""

    status: WriteStatus
    obj: int
    held: int
    why: str = ""

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBBIB")

    def pack(self) -> bytes:
        """Give the body's bytes; a long sentence is cut."""
        why = cut_text(self.why, _WHY_BYTES)
        return self._LAYOUT.pack(_WRITTEN, self.status, self.obj, self.held, len(why)) + why

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read an answer; raises WireError where it is cut or of an unknown kind or status."""
        status, obj, held, length = _fields(cls._LAYOUT, body, _WRITTEN, "an answer to a write")
        if status > max(WriteStatus):
            raise WireError(f"an answer to a write of status {status}: 0 to {max(WriteStatus)} are known")
        why = body[cls._LAYOUT.size :][:length]
        if len(why) != length:
            raise WireError(f"a sentence of {length} bytes of which {len(why)} are there")
        return cls(WriteStatus(status), obj, held, why.decode(errors="replace"))


def _fields(layout: struct.Struct, body: bytes, due: int, what: str) -> tuple[Any, ...]:
    kind, *fields = read_fields(layout, body, what)
    if kind != due:
        raise WireError(f"{what} of kind {kind}: it has kind {due}")
    return tuple(fields)


BulkRequest = ReadRequest | WriteBegin | WritePart | WriteCommit

_REQUESTS: Mapping[int, Callable[[bytes], BulkRequest]] = {
    _READ: ReadRequest.unpack,
    _BEGIN: WriteBegin.unpack,
    _PART: WritePart.unpack,
    _COMMIT: WriteCommit.unpack,
}


def read_bulk_request(body: bytes) -> BulkRequest:
    """Read whatever a host asks on the bulk channel; raises WireError, also on a kind that this version does not know."""
    reader = _REQUESTS.get(body[0]) if body else None
    if reader is None:
        raise WireError(f"a bulk request of kind {body[:1].hex() or 'missing'}: known are {sorted(_REQUESTS)}")
    return reader(body)


def read_bulk_reply(body: bytes) -> ReadReply | WriteReply:
    """Read whatever a device answers on the bulk channel; raises WireError."""
    return WriteReply.unpack(body) if body[:1] == bytes([_WRITTEN]) else ReadReply.unpack(body)


def answer_read(request: ReadRequest, content: bytes | None, version: int, mtu: int) -> ReadReply:
    """Answer with as much of `content` as was asked for and fits one packet; None: there is no such object."""
    if content is None:
        return ReadReply(ReadStatus.NO_SUCH_OBJECT, request.obj, 0, 0, request.offset, b"")
    status = ReadStatus.OK
    if request.version not in (0, version):
        status = ReadStatus.CHANGED
    elif request.offset > len(content):
        status = ReadStatus.BEYOND_END
    room = min(request.length, mtu - ReadReply._LAYOUT.size)
    data = content[request.offset : request.offset + room] if status is ReadStatus.OK else b""
    return ReadReply(status, request.obj, version, len(content), request.offset, data)
