"""A recording that was cut, or damaged, made whole again: everything that is still what it was, with a new index."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, Channel, Metadata

from prismstereo.recording.chunk import Damage, PlainMessage
from prismstereo.recording.container import Container, TopicKind
from prismstereo.recording.errors import RecordingError
from prismstereo.recording.journal import LIBRARY
from prismstereo.recording.output import FileOutput
from prismstereo.recording.recording import Recording
from prismstereo.recording.stored_packet import PACKET_TOPIC, StoredPacket

__all__ = ["Recovered", "recover"]

_MOST_TOPICS = 1000


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was brought over: `packets` and other `messages`; `damage` is what was not. `why_cut`: how the source ends."""

    packets: int
    messages: int
    damage: Damage
    seconds: float
    why_cut: str


def recover(source: str | Path, out: str | Path) -> Recovered:
    """Write a whole recording `out` of whatever can be read of `source`, which stays as it is.

    Raises RecordingError where the source is no recording, `out` is there already, or cannot be written; nothing is left then.
    """
    with Recording(source) as recording:
        output = FileOutput(Path(out))
        try:
            return _Transfer(recording, Container(output, LIBRARY)).run()
        except OSError as error:
            output.close()
            _forget(Path(out))
            raise RecordingError(f"cannot write {out}: {error.strerror}: nothing was kept, make room") from error
        except BaseException:
            output.close()
            _forget(Path(out))
            raise


def _forget(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


class _Transfer:
    """From one recording to another file."""

    def __init__(self, recording: Recording, container: Container) -> None:
        self._recording = recording
        self._container = container
        self._topics: dict[int, int] = {}
        self._damage = Damage(chunks=recording.outline.damaged, notes=recording.damaged_texts)

    def run(self) -> Recovered:
        for channel in self._recording.outline.channels.values():
            self._topic(channel)
        self._keep_stored()
        packets = messages = 0
        for message in self._recording.messages(self._damage):
            topic = self._recording.topic(message)
            if not self._is_sound(message, topic):
                continue
            self._container.add(self._topic_of(message), message.time_ns, message.data)
            packets += topic == PACKET_TOPIC
            messages += topic != PACKET_TOPIC
        self._container.finish()
        return Recovered(packets, messages, self._damage, self._recording.length_s, self._recording.why_cut)

    def _is_sound(self, message: PlainMessage, topic: str) -> bool:
        if topic == PACKET_TOPIC:
            sound = StoredPacket.unpack(message.data) is not None
            self._damage.packets += not sound
        else:
            sound = bool(topic) and message.trusted
            self._damage.notes += not sound
        return sound

    def _topic_of(self, message: PlainMessage) -> int:
        return self._topic(self._recording.outline.channels[message.topic])

    def _topic(self, channel: Channel) -> int:
        if channel.id not in self._topics:
            if len(self._topics) >= _MOST_TOPICS:
                raise RecordingError(f"{self._recording.path} has more than {_MOST_TOPICS} topics: no recording has")
            schema = self._recording.outline.schemas.get(channel.schema_id)
            described = ("", "", b"") if schema is None else (schema.name, schema.encoding, schema.data)
            kind = TopicKind(channel.message_encoding, *described, compressed=channel.topic != PACKET_TOPIC)
            self._topics[channel.id] = self._container.topic(channel.topic, kind)
        return self._topics[channel.id]

    def _keep_stored(self) -> None:
        for stored in self._recording.outline.stored:
            match stored.record:
                case Attachment(name=name, media_type=media_type, log_time=time_ns, data=data):
                    self._container.attach(name, media_type, time_ns, data)
                case Metadata(name=name, metadata=texts):
                    self._container.describe(name, texts)
