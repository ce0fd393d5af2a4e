"""A recording as a reader sees it: who was recorded, with which calibrations, and every packet that is still what it was."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec
from mcap.records import Attachment, Metadata

from prismstereo.recording.chunk import Damage, PlainMessage, messages_of
from prismstereo.recording.errors import RecordingError
from prismstereo.recording.notes import (
    CLOCK_TOPIC,
    EVENT_TOPIC,
    ClockNote,
    EventNote,
    SessionNote,
    read_note,
    undescribed,
)
from prismstereo.recording.outline import Outline, outline_of
from prismstereo.recording.stored_packet import PACKET_TOPIC, StoredPacket
from prismstereo_device.protocol import calibration_hash
from prismstereo_device.wire import LIMITS

__all__ = ["CALIBRATION", "IDENTITY", "RECORDING", "SESSION", "Entry", "Recording", "StoredCalibration"]

CALIBRATION = "calibration"  # how the names of attachments and texts begin
IDENTITY = "identity.json"
RECORDING = "prismstereo"
SESSION = "session"
_READ_AT_ONCE = 1 << 20
Entry = StoredPacket | EventNote | ClockNote


@dataclass(frozen=True, slots=True)
class StoredCalibration:
    """Flash bytes that the camera held, and the wall clock in nanoseconds from which on they are known to have been there."""

    content: bytes
    from_ns: int

    @property
    def hash(self) -> bytes:
        """The 8 bytes that frames name it by."""
        return calibration_hash(self.content)


class Recording:
    """An open recording; a context manager. `RecordingError` for a file that is none.

    A file that was cut is read as far as it goes: `finished` is False, and `why_cut` says how it ends. `info` are the texts
    that the recorder left (`version`, `device_id`, `rig`, `label`, `started`, ...). `start_ns` and `end_ns` are the wall
    clock of the first and the last message in nanoseconds.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self._file = self.path.open("rb")
        except OSError as error:
            raise RecordingError(f"cannot read {path}: {error.strerror}: give a recording, NAME.mcap") from error
        try:
            self._outline = outline_of(self._file, str(path))
            self._require_packets()
        except OSError as error:
            self._file.close()
            raise RecordingError(f"cannot read {path}: {error.strerror}: is it a file?") from error
        except BaseException:
            self._file.close()
            raise
        self.damaged_texts = 0
        self.info: Mapping[str, str] = {}
        self.sessions: dict[int, SessionNote] = {}
        self.calibrations: list[StoredCalibration] = []
        self.identity = b""
        self._read_stored()

    @property
    def outline(self) -> Outline:
        """What lies where in the file."""
        return self._outline

    @property
    def finished(self) -> bool:
        """Whether the recorder wrote the file to its end."""
        return self._outline.finished

    @property
    def why_cut(self) -> str:
        """How the file ends where it was not finished; empty where it was."""
        return self._outline.why_cut

    @property
    def start_ns(self) -> int:
        """Wall clock of the first message in nanoseconds."""
        return min((chunk.start_ns for chunk in self._outline.chunks), default=0)

    @property
    def end_ns(self) -> int:
        """Wall clock of the last message in nanoseconds."""
        return max((chunk.end_ns for chunk in self._outline.chunks), default=0)

    @property
    def length_s(self) -> float:
        """From the first to the last message, in seconds."""
        return max(0, self.end_ns - self.start_ns) * 1e-9

    def entries(self, damage: Damage | None = None, *, from_ns: int = 0) -> Iterator[tuple[int, Entry]]:
        """Give (wall clock in nanoseconds, packet or note), in the order of recording, of chunks that reach `from_ns`.

        What cannot be read is left out, and counted in `damage`.
        """
        damage = Damage() if damage is None else damage
        for message in self.messages(damage, from_ns=from_ns):
            entry = self._entry(message, damage)
            if entry is not None:
                yield message.time_ns, entry

    def packets(self, damage: Damage | None = None) -> Iterator[StoredPacket]:
        """Give the packets alone."""
        return (entry for _, entry in self.entries(damage) if isinstance(entry, StoredPacket))

    def messages(self, damage: Damage, *, from_ns: int = 0) -> Iterator[PlainMessage]:
        """Give every message of every topic as it stands in the file; raises RecordingError where the disk fails."""
        outline = self._outline
        try:
            for chunk in outline.chunks:
                if chunk.end_ns >= from_ns or chunk.end_ns < chunk.start_ns:
                    yield from messages_of(self._file, chunk, outline.channels, outline.schemas, damage)
        except OSError as error:
            raise RecordingError(f"cannot read on in {self.path}: {error.strerror}") from error

    def topic(self, message: PlainMessage) -> str:
        """Name a message's topic; empty where the file does not say."""
        channel = self._outline.channels.get(message.topic)
        return "" if channel is None else channel.topic

    def sum_is_right(self) -> bool | None:
        """Read the whole file and hold it against its own check sum; None where it has none, because it was cut."""
        if not self._outline.data_crc:
            return None
        self._file.seek(0)
        left, crc = self._outline.data_end, 0
        while left and (data := self._file.read(min(left, _READ_AT_ONCE))):
            crc = zlib.crc32(data, crc)
            left -= len(data)
        return crc == self._outline.data_crc

    def calibration(self, hash_start: bytes) -> bytes | None:
        """Give the flash bytes whose hash begins so; None where they were not recorded."""
        return next((one.content for one in self.calibrations if one.hash.startswith(hash_start)), None)

    def close(self) -> None:
        """Give the file back."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _require_packets(self) -> None:
        """Refuse an MCAP file of something else; one that another tool wrote names its topics in its first chunk."""
        for chunk in self._outline.chunks[:1]:
            for _ in messages_of(self._file, chunk, self._outline.channels, self._outline.schemas, Damage()):
                pass
        topics = {channel.topic for channel in self._outline.channels.values()}
        if PACKET_TOPIC not in topics:
            raise RecordingError(
                f"{self.path} holds no packets of a prism stereo sensor (topics: {', '.join(sorted(topics)[:8]) or 'none'}): "
                "give a file that `prismstereo record` wrote"
            )

    def _read_stored(self) -> None:
        for stored in self._outline.stored:
            match stored.record:
                case Attachment(name=name, data=data, log_time=time_ns) if name.startswith(CALIBRATION):
                    if name.endswith(".bin") and len(data) <= LIMITS.calibration:
                        self.calibrations.append(StoredCalibration(data, time_ns))
                case Attachment(name=name, data=data) if name == IDENTITY:
                    self.identity = data
                case Metadata(name=name, metadata=texts) if name in (RECORDING, SESSION):
                    self._read_texts(name, texts)

    def _read_texts(self, name: str, texts: Mapping[str, str]) -> None:
        plain = undescribed(texts)
        if plain is None:
            self.damaged_texts += 1
        elif name == RECORDING:
            self.info = plain
        else:
            try:
                note = msgspec.convert(plain, SessionNote, strict=False)
            except msgspec.MsgspecError:
                self.damaged_texts += 1
            else:
                self.sessions[note.session] = note

    def _entry(self, message: PlainMessage, damage: Damage) -> Entry | None:
        topic = self.topic(message)
        if topic == PACKET_TOPIC:
            packet = StoredPacket.unpack(message.data)
            damage.packets += packet is None
            return packet
        if topic not in (EVENT_TOPIC, CLOCK_TOPIC):
            return None
        note: EventNote | ClockNote | None = None
        if message.trusted and topic == EVENT_TOPIC:
            note = read_note(message.data, EventNote)
        elif message.trusted:
            note = read_note(message.data, ClockNote)
        damage.notes += note is None
        return note
