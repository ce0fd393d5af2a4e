"""Raw frames out of a recording, and today's depth of them: another matcher, or a better calibration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from prismstereo.recording.chunk import Damage
from prismstereo.recording.recording import Recording
from prismstereo.recording.stored_packet import StoredPacket
from prismstereo_device.protocol import DisparityHead, PictureAssembler
from prismstereo_device.wire import FIRST, Channel, WireError
from prismstereo_hw.frame import RawFrame

__all__ = ["RecordedRaw", "raw_frames"]


@dataclass(frozen=True, slots=True)
class RecordedRaw:
    """A raw frame, its session, and the flash bytes of the calibration that the camera used then; empty where unknown."""

    frame: RawFrame
    session: int
    calibration: bytes


def raw_frames(recording: Recording, damage: Damage) -> Iterator[RecordedRaw]:
    """Give the raw frames of a recording in order. One of which a packet is lost is left out; WireError for one that lies."""
    assembler, session, named = PictureAssembler(), 0, b""
    for stored in recording.packets(damage):
        packet = stored.packet
        if stored.session != session:
            assembler, session, named = PictureAssembler(), stored.session, _named_at(recording, stored)
        if packet.channel == Channel.DISP and packet.flags & FIRST:
            named = _hash_of(stored) or named
        if packet.channel != Channel.RAW:
            continue
        for picture in assembler.feed(packet):
            head = picture.head
            frame = RawFrame(picture.pixels(), head.frame, head.timestamp_us, head.lens_position)
            content = recording.calibration(named) if any(named) else None
            yield RecordedRaw(frame, session, content or b"")


def _named_at(recording: Recording, stored: StoredPacket) -> bytes:
    note = recording.sessions.get(stored.session)
    return b"" if note is None else bytes.fromhex(note.calibration_hash)


def _hash_of(stored: StoredPacket) -> bytes:
    try:
        named = DisparityHead.unpack(stored.packet.payload).calibration_hash
    except WireError:
        return b""
    return named if any(named) else b""
