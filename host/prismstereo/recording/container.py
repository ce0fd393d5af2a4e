"""An MCAP file as it is written: chunk by chunk, whole after every step, with an index at the end.

The records are the `mcap` library's. Its `Writer` is not used, for three things that a recorder needs and it has not: a write
that fails leaves this one as it was, so that a full disk can still be given an ending; device packets stay uncompressed
beside compressed pictures, so that a flipped bit costs one packet and not a chunk; and every schema and channel stands before
the first chunk, so that no damage to a chunk costs more than that chunk.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from prismstereo.recording.output import Output

__all__ = ["MAGIC", "Container", "TopicKind"]

MAGIC = b"\x89MCAP0\r\n"
_CHUNK_BYTES = 1 << 20
_FOOTER_START = struct.Struct("<BQQQ")
_FOOTER_BYTES = 20


@dataclass(frozen=True, slots=True)
class TopicKind:
    """What messages of a topic are: their encoding, and the schema that describes it; `compressed`: worth zstd."""

    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes
    compressed: bool = False


@dataclass(slots=True)
class _OpenChunk:
    """Messages that are not in the file yet."""

    records: RecordBuilder = field(default_factory=RecordBuilder)
    index: dict[int, list[tuple[int, int]]] = field(default_factory=dict)

    @property
    def size(self) -> int:
        return int(self.records.count)

    def add(self, message: Message) -> None:
        self.index.setdefault(message.channel_id, []).append((message.log_time, self.size))
        message.write(self.records)


class Container:
    """Appends to an empty `output`, which it owns. Whatever raises OSError has left the file whole, without what was new.

    Messages wait in memory until `sync`, or until there is a mebibyte of them.
    """

    def __init__(self, output: Output, library: str) -> None:
        self._output = output
        self._size = 0
        self._crc = 0
        self._open = {False: _OpenChunk(), True: _OpenChunk()}  # by whether it is compressed
        self._kinds: dict[int, TopicKind] = {}
        self._schemas: dict[tuple[str, str, bytes], Schema] = {}
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._append(MAGIC + _packed(Header("", library)))

    @property
    def size(self) -> int:
        """Bytes of the file so far."""
        return self._size

    def topic(self, name: str, kind: TopicKind) -> int:
        """Announce a topic and return its number."""
        key = (kind.schema_name, kind.schema_encoding, kind.schema)
        schema = self._schemas.get(key)
        data = b""
        if schema is None:
            schema = Schema(len(self._schemas) + 1, kind.schema, kind.schema_encoding, kind.schema_name)
            data = _packed(schema)
        channel = Channel(len(self._channels) + 1, name, kind.encoding, {}, schema.id)
        self._append(data + _packed(channel))
        self._schemas[key] = schema
        self._channels.append(channel)
        self._kinds[channel.id] = kind
        return channel.id

    def add(self, topic: int, time_ns: int, data: bytes) -> None:
        """Add a message, with the wall clock of when it came in nanoseconds."""
        chunk = self._open[self._kinds[topic].compressed]
        chunk.add(Message(topic, time_ns, data, time_ns, 0))
        if chunk.size >= _CHUNK_BYTES:
            self._close(compressed=self._kinds[topic].compressed)

    def attach(self, name: str, media_type: str, time_ns: int, data: bytes) -> None:
        """Add a file inside of the file, behind all messages so far."""
        self._close_all()
        record = _packed(Attachment(time_ns, time_ns, name, media_type, data))
        begin = self._size
        self._append(record)
        self._attachments.append(AttachmentIndex(begin, len(record), time_ns, time_ns, len(data), name, media_type))

    def describe(self, name: str, values: Mapping[str, str]) -> None:
        """Add named texts, behind all messages so far."""
        self._close_all()
        record = _packed(Metadata(name, dict(values)))
        begin = self._size
        self._append(record)
        self._metadata.append(MetadataIndex(begin, len(record), name))

    def sync(self) -> None:
        """Return when every message so far outlives a power cut."""
        self._close_all()
        self._output.sync()

    def finish(self) -> None:
        """Write the index, make everything safe and give the file back."""
        self._close_all()
        end = _packed(DataEnd(zlib.crc32(b"", self._crc)))
        start = self._size + len(end)
        summary, offsets_at = self._summary(start)
        footer_start = _FOOTER_START.pack(Opcode.FOOTER, _FOOTER_BYTES, start, offsets_at)
        footer = Footer(start, offsets_at, zlib.crc32(footer_start, zlib.crc32(summary)))
        self._append(end + summary + _packed(footer) + MAGIC)
        self._output.sync()
        self._output.close()

    def leave(self) -> None:
        """Give the file back as it is: readable, with no index."""
        self._output.close()

    def _append(self, data: bytes) -> None:
        try:
            self._output.append(data)
        except OSError:
            with suppress(OSError):
                self._output.cut(self._size)
            raise
        self._size += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def _close_all(self) -> None:
        for compressed in self._open:
            self._close(compressed=compressed)

    def _close(self, *, compressed: bool) -> None:
        """Put the messages that wait into the file; where that fails they are lost, and the file is as it was."""
        waiting, self._open[compressed] = self._open[compressed], _OpenChunk()
        if not waiting.index:
            return
        plain = _content(waiting.records)
        data = zstandard.ZstdCompressor().compress(plain) if compressed else plain
        times = [time_ns for entries in waiting.index.values() for time_ns, _ in entries]
        chunk = Chunk("zstd" if compressed else "", data, max(times), min(times), zlib.crc32(plain), len(plain))
        record = _packed(chunk)
        index = ChunkIndex(
            chunk_length=len(record),
            chunk_start_offset=self._size,
            compression=chunk.compression,
            compressed_size=len(data),
            message_end_time=chunk.message_end_time,
            message_index_length=0,
            message_index_offsets={},
            message_start_time=chunk.message_start_time,
            uncompressed_size=len(plain),
        )
        for topic, entries in waiting.index.items():
            index.message_index_offsets[topic] = self._size + len(record)
            record += _packed(MessageIndex(topic, entries))
        index.message_index_length = len(record) - index.chunk_length
        self._append(record)
        self._chunks.append(index)
        for topic, entries in waiting.index.items():
            self._counts[topic] = self._counts.get(topic, 0) + len(entries)

    def _summary(self, start: int) -> tuple[bytes, int]:
        """Give the summary's bytes, to stand at `start`, and where the offsets of its groups begin."""
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels)),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, list(self._chunks)),
            (Opcode.ATTACHMENT_INDEX, list(self._attachments)),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(_packed(record) for record in records)
            if group:
                offsets += _packed(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        return summary + offsets, start + len(summary)

    def _statistics(self) -> Statistics:
        starts = [chunk.message_start_time for chunk in self._chunks]
        ends = [chunk.message_end_time for chunk in self._chunks]
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max(ends, default=0),
            message_start_time=min(starts, default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def _packed(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return _content(builder)


def _content(builder: RecordBuilder) -> bytes:
    end: Callable[[], bytes] = builder.end
    return end()
