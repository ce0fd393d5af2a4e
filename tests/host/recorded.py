"""Recordings with a known content, for the tests of recording."""

from __future__ import annotations

import random
from pathlib import Path

from host.counting import CALIBRATION, disparity
from host.recording_disk import ModelDisk
from prismstereo.recording import Recording
from prismstereo.recording.journal import Journal
from prismstereo.recording.notes import EventNote, SessionNote
from prismstereo.recording.output import FileOutput, Output
from prismstereo.recording.stored_packet import StoredPacket
from prismstereo_device.framing import Packet
from prismstereo_device.protocol import calibration_hash, fragment
from prismstereo_device.wire import Channel

FRAME_US = 66_667
NAMED = calibration_hash(CALIBRATION)


def session_note(session: int = 1, boot_id: int = 77, content: bytes = CALIBRATION) -> SessionNote:
    return SessionNote(session, b"serial-1".hex(), boot_id, calibration_hash(content).hex(), 1, 1, 0)


def frame_packets(
    index: int, *, at_us: int, session: int = 1, named: bytes = NAMED, mtu: int = 1024
) -> list[StoredPacket]:
    """The packets of frame `index`, as the counting source makes it."""
    parts = fragment(
        disparity(index % 16), frame=index, timestamp_us=1000 * index, calibration_hash=named, mtu=mtu, bound=0
    )
    return [
        StoredPacket(Packet(Channel.DISP, payload, flags, number & 0xFFFF, index & 0xFFFF, number), at_us, session)
        for flags, number, payload in parts
    ]


def begin(output: Output, *, views_hz: float = 0.0) -> Journal:
    journal = Journal(output, views_hz)
    journal.describe({"label": "of a test"})
    journal.identify({"serial": "serial-1"})
    journal.calibrate(CALIBRATION)
    journal.write(session_note())
    return journal


def write_recording(path: Path, frames: int, *, finished: bool = True) -> list[StoredPacket]:
    """Write a recording of so many frames at 15 a second; return its packets."""
    journal = begin(FileOutput(path))
    packets = [packet for index in range(frames) for packet in frame_packets(index, at_us=1_000_000 + FRAME_US * index)]
    for number, packet in enumerate(packets):
        journal.write(packet)
        if number % 40 == 39:
            journal.sync(None)
    if finished:
        journal.finish()
    else:
        journal.sync(None)
        journal.leave()
    return packets


def cut_while_writing(path: Path, rng: random.Random) -> tuple[list[StoredPacket], int, list[StoredPacket]]:
    """Cut the power of a recorder at any moment; give what it wrote, how much of that was synced, and what is left."""
    disk = ModelDisk()
    journal = begin(disk)
    written, safe = list[StoredPacket](), 0
    for index in range(rng.randrange(40, 160)):
        payload = [index.to_bytes(4, "little") + rng.randbytes(2800) for _ in range(3)]
        for part, data in enumerate(payload):
            packet = StoredPacket(Packet(Channel.DISP, data, 0, part, index, part), FRAME_US * index, 1)
            journal.write(packet)
            written.append(packet)
        if index % 15 == 14:
            journal.write(EventNote("silent", 1, FRAME_US * index, "every second"))
            journal.sync(None)
            safe = len(written)
    path.write_bytes(disk.after_a_cut(rng))
    with Recording(path) as recording:
        return written, safe, list(recording.packets())
