"""What lies where in an MCAP file, found by walking from record to record; the index at its end is neither needed nor believed.

The file may come from anybody: every size is held against the file and against a limit before anything is read.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import BinaryIO, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, DataEnd, McapRecord, Metadata, Schema

from prismstereo.recording.container import MAGIC
from prismstereo.recording.errors import RecordingError

__all__ = ["RECORD_LIMIT", "ChunkPlace", "Outline", "Place", "Stored", "outline_of", "read_record"]

RECORD_LIMIT = 64 << 20  # bytes of one record, and of one chunk when it is unfolded
_MOST_RECORDS = 20_000_000
_MOST_KEPT = 4096  # attachments, texts, topics
_MOST_KEPT_BYTES = 256 << 20
_KEPT = (Opcode.ATTACHMENT, Opcode.METADATA, Opcode.CHANNEL, Opcode.SCHEMA)
_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_MALFORMED = (struct.error, UnicodeDecodeError, McapError, OverflowError)

Record = TypeVar("Record", bound=McapRecord)


@dataclass(frozen=True, slots=True)
class Place:
    """A record: what it is, where its content begins and how long it is; `there` is less where the file is cut."""

    opcode: int
    begin: int
    length: int
    there: int


@dataclass(frozen=True, slots=True)
class ChunkPlace:
    """A chunk, and the wall clock of its first and last message in nanoseconds."""

    place: Place
    start_ns: int
    end_ns: int


@dataclass(frozen=True, slots=True)
class Stored:
    """An attachment or a metadata record, and where in the file it stands."""

    at: int
    record: Attachment | Metadata


@dataclass(slots=True)
class Outline:
    """The whole of a file: `finished` where its index was written, else `why_cut` says how it ends.

    `data_crc` is the check sum of all bytes before `data_end`, where the file says one. `damaged` records could not be read.
    """

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
    stored: list[Stored] = field(default_factory=list)
    finished: bool = False
    why_cut: str = ""
    data_end: int = 0
    data_crc: int = 0
    damaged: int = 0
    held_bytes: int = 0


def outline_of(file: BinaryIO, name: str) -> Outline:
    """Walk a file that can be sought in; `RecordingError` where it is no MCAP file, or has more records than anything has."""
    size = file.seek(0, io.SEEK_END)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise RecordingError(f"{name} is no recording: it does not begin as an MCAP file does")
    outline = Outline()
    for place in _places(file, size, name, outline):
        outline.data_end = place.begin - _HEAD.size
        if place.opcode == Opcode.DATA_END:
            outline.finished = True
            end = _guarded(DataEnd.read, file, place, outline)
            outline.data_crc = 0 if end is None else end.data_section_crc
            return outline
        _note(file, place, outline, name)
        outline.data_end = place.begin + place.there
    return outline


def read_record(file: BinaryIO, place: Place) -> bytes:
    """Give what is there of a record's content."""
    file.seek(place.begin)
    return file.read(place.there)


def _places(file: BinaryIO, size: int, name: str, outline: Outline) -> Iterator[Place]:
    position = len(MAGIC)
    for _ in range(_MOST_RECORDS):
        file.seek(position)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            outline.why_cut = "it ends where a record should begin"
            return
        opcode, length = _HEAD.unpack(head)
        if opcode == 0 or length > RECORD_LIMIT:
            outline.why_cut = f"what stands at byte {position} is no record"
            return
        there = min(length, size - position - _HEAD.size)
        yield Place(opcode, position + _HEAD.size, length, there)
        if there < length:
            outline.why_cut = f"its last record has {there} of {length} bytes"
            return
        position += _HEAD.size + length
    raise RecordingError(f"{name} has more than {_MOST_RECORDS} records: no recording has")


def _note(file: BinaryIO, place: Place, outline: Outline, name: str) -> None:
    match place.opcode:
        case Opcode.CHUNK:
            _note_chunk(file, place, outline)
        case Opcode.CHANNEL if (channel := _guarded(Channel.read, file, place, outline)) is not None:
            outline.channels[channel.id] = channel
        case Opcode.SCHEMA if (schema := _guarded(Schema.read, file, place, outline)) is not None:
            outline.schemas[schema.id] = schema
        case Opcode.ATTACHMENT if _crc_is_right(file, place):
            _keep(_guarded(Attachment.read, file, place, outline), place, outline)
        case Opcode.ATTACHMENT:
            outline.damaged += 1
        case Opcode.METADATA:
            _keep(_guarded(Metadata.read, file, place, outline), place, outline)
    outline.held_bytes += place.there if place.opcode in _KEPT else 0
    kept = len(outline.stored) + len(outline.channels) + len(outline.schemas)
    if kept > _MOST_KEPT or outline.held_bytes > _MOST_KEPT_BYTES:
        raise RecordingError(
            f"{name} has {kept} attachments, texts and topics, {outline.held_bytes} bytes beside its messages: at most "
            f"{_MOST_KEPT} and {_MOST_KEPT_BYTES} are read"
        )


def _note_chunk(file: BinaryIO, place: Place, outline: Outline) -> None:
    head = read_record(file, Place(place.opcode, place.begin, place.length, min(place.there, _CHUNK_HEAD.size)))
    if len(head) == _CHUNK_HEAD.size:
        start_ns, end_ns, _, _ = _CHUNK_HEAD.unpack(head)
        outline.chunks.append(ChunkPlace(place, start_ns, end_ns))


def _keep(record: Attachment | Metadata | None, place: Place, outline: Outline) -> None:
    if record is not None:
        outline.stored.append(Stored(place.begin, record))


def _crc_is_right(file: BinaryIO, place: Place) -> bool:
    content = read_record(file, place)
    return len(content) >= 4 and zlib.crc32(content[:-4]) == int.from_bytes(content[-4:], "little")


def _guarded(
    reader: Callable[[ReadDataStream], Record], file: BinaryIO, place: Place, outline: Outline
) -> Record | None:
    """Read a record that may hold anything; None, and counted, where it makes no sense."""
    try:
        return reader(ReadDataStream(io.BytesIO(read_record(file, place))))
    except _MALFORMED:
        outline.damaged += 1
        return None
