"""Objects by offset: the host asks for a part, the device answers with it; a lost answer is simply asked for again."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, Self

from prismstereo_device.protocol.body import read_fields
from prismstereo_device.wire import LIMITS, WireError

__all__ = ["CALIBRATION", "ReadReply", "ReadRequest", "ReadStatus", "answer_read"]

CALIBRATION = 1  # the object that holds the calibration's flash bytes
_READ = 1  # kind of both bodies


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
        kind, *fields = read_fields(cls._LAYOUT, body, "a bulk request")
        if kind != _READ:
            raise WireError(f"a bulk request of kind {kind}: 1 (read) is known")
        return cls(*fields)


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
