"""The messages of one chunk of an MCAP file, whoever wrote it and whatever happened to it since."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from prismstereo.recording.outline import RECORD_LIMIT, ChunkPlace, read_record

__all__ = ["Damage", "PlainMessage", "messages_of"]

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQII")
_MALFORMED = (struct.error, UnicodeDecodeError, McapError, OverflowError)


@dataclass(slots=True)
class Damage:
    """What could not be read: `packets` and `notes` with a wrong check sum, `chunks` of which some or all is lost."""

    packets: int = 0
    notes: int = 0
    chunks: int = 0

    @property
    def any(self) -> bool:
        """Whether anything is."""
        return bool(self.packets or self.notes or self.chunks)


@dataclass(frozen=True, slots=True)
class PlainMessage:
    """A message: its topic's number, its wall clock in nanoseconds, its bytes; `trusted` where the chunk's sum is right."""

    topic: int
    time_ns: int
    data: bytes
    trusted: bool


def messages_of(
    file: BinaryIO, chunk: ChunkPlace, channels: dict[int, Channel], schemas: dict[int, Schema], damage: Damage
) -> Iterator[PlainMessage]:
    """Give the messages of a chunk, as far as they can be read; channels and schemas in it are added to those known.

    A chunk whose own sum is wrong is read all the same, if it is not compressed: its packets have sums of their own. Never
    raises but OSError.
    """
    found = _plain(read_record(file, chunk.place), whole=chunk.place.there == chunk.place.length)
    if found is None:
        damage.chunks += 1
        return
    plain, trusted = found
    damage.chunks += not trusted
    position = 0
    while position + _HEAD.size <= len(plain):
        opcode, length = _HEAD.unpack_from(plain, position)
        position += _HEAD.size
        content = plain[position : position + length]
        position += length
        if len(content) < length:
            damage.chunks += trusted
            return
        if opcode == Opcode.MESSAGE and length >= _MESSAGE.size:
            topic, _, time_ns, _ = _MESSAGE.unpack_from(content)
            yield PlainMessage(topic, time_ns, bytes(content[_MESSAGE.size :]), trusted)
        elif trusted and opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            _learn(opcode, bytes(content), channels, schemas)


def _learn(opcode: int, content: bytes, channels: dict[int, Channel], schemas: dict[int, Schema]) -> None:
    stream = ReadDataStream(io.BytesIO(content))
    try:
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            channels.setdefault(channel.id, channel)
        else:
            schema = Schema.read(stream)
            schemas.setdefault(schema.id, schema)
    except _MALFORMED:
        return


def _plain(content: bytes, *, whole: bool) -> tuple[memoryview, bool] | None:
    """Unfold a chunk, and say whether its sum is right; None where nothing can be had of it."""
    if not whole:  # the end of a file that was cut: what is there of an uncompressed chunk is read
        compression_at = _CHUNK.size - 4
        empty = content[compression_at : _CHUNK.size] == bytes(4)
        return (memoryview(content)[_CHUNK.size + 8 :], False) if empty and len(content) > _CHUNK.size + 8 else None
    try:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(content)))
    except _MALFORMED:
        return None
    data = chunk.data
    if chunk.uncompressed_size > RECORD_LIMIT or chunk.compression not in ("", "zstd"):
        return None
    if chunk.compression == "zstd":
        unfolded = _unfolded(data, chunk.uncompressed_size)
        if unfolded is None:
            return None
        data = unfolded
    right = chunk.uncompressed_crc in (0, zlib.crc32(data))  # 0: its writer made none
    trusted = right and len(data) == chunk.uncompressed_size
    return (memoryview(data), trusted) if trusted or chunk.compression == "" else None


def _unfolded(data: bytes, size: int) -> bytes | None:
    """Decompress what says of itself, too, that it has `size` bytes: a few kilobytes of zstd can unfold to gigabytes."""
    try:
        if zstandard.get_frame_parameters(data).content_size != size:
            return None
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size, allow_extra_data=False)
    except zstandard.ZstdError:
        return None
