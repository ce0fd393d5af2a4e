from __future__ import annotations

import random
import struct
import time
import tracemalloc
from pathlib import Path

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, DataEnd, Header, McapRecord, Metadata, Schema

from host.recorded import write_recording
from prismstereo.recording import Damage, Recording, RecordingError, RecordingFolder, replay
from prismstereo.recording.container import MAGIC
from prismstereo.recording.notes import ClockNote, SessionNote, described, read_note, undescribed
from prismstereo.recording.output import FileOutput
from prismstereo_hw.errors import UsageError

TOPIC = Channel(1, "/prismstereo/packets", "x-prismstereo-packet", {}, 1)


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _file(path: Path, *records: McapRecord, tail: bytes = b"") -> Path:
    known = (Header("", ""), Schema(1, b"", "", "prismstereo.Packet"), TOPIC, *records)
    path.write_bytes(MAGIC + b"".join(_bytes(record) for record in known) + tail)
    return path


BOMB = zstandard.ZstdCompressor().compress(bytes(100 << 20))


@pytest.mark.parametrize(
    "chunk",
    [
        Chunk("zstd", BOMB, 1, 0, 0, 100 << 20),  # says what it is
        Chunk("zstd", BOMB, 1, 0, 0, 1000),  # says that it is small
        Chunk("lz4", BOMB, 1, 0, 0, 1000),
        Chunk("zstd", b"no zstd at all", 1, 0, 0, 1000),
        Chunk("", b"\x05" + b"\xff" * 40, 1, 0, 0, 41),  # a message that is longer than its chunk
        Chunk("", struct.pack("<BQ", 5, 3) + b"abc", 1, 0, 0, 12),  # one that is too short to be one
    ],
)
def test_a_chunk_that_lies_is_left_out_before_it_unfolds(tmp_path: Path, chunk: Chunk) -> None:
    path = _file(tmp_path / "hostile.mcap", chunk, DataEnd(0))
    tracemalloc.start()
    begin_s = time.monotonic()
    with Recording(path) as recording:
        assert list(recording.packets(Damage())) == []
    assert time.monotonic() - begin_s < 0.5
    assert tracemalloc.get_traced_memory()[1] < 16 << 20
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("tail", "why"),
    [
        (struct.pack("<BQ", 6, 1 << 62), "no record"),
        (struct.pack("<BQ", 9, 1 << 30), "no record"),
        (struct.pack("<BQ", 9, 1000) + b"cut", "has 3 of 1000 bytes"),
        (bytes(4096), "no record"),
        (b"\x06", "ends where a record should begin"),
    ],
)
def test_a_file_that_ends_badly_is_read_up_to_there_and_says_why(tmp_path: Path, tail: bytes, why: str) -> None:
    with Recording(_file(tmp_path / "cut.mcap", tail=tail)) as recording:
        assert why in recording.why_cut
        assert not recording.finished


def test_a_file_of_something_else_is_refused_by_name(tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_bytes(MAGIC + _bytes(Header("", "")) + _bytes(Channel(1, "/tf", "cdr", {}, 0)))
    with pytest.raises(RecordingError, match=r"no packets of a prism stereo sensor \(topics: /tf\)"):
        Recording(other)
    for content in (b"", b"PK\x03\x04" + bytes(100), MAGIC[:4]):
        other.write_bytes(content)
        with pytest.raises(RecordingError, match="does not begin as an MCAP file"):
            Recording(other)
    with pytest.raises(RecordingError, match="No such file"):
        Recording(tmp_path / "nowhere.mcap")
    with pytest.raises(RecordingError, match="Is a directory"):
        Recording(tmp_path)


def test_any_bytes_after_the_beginning_raise_nothing_but_a_recording_error(tmp_path: Path) -> None:
    path, rng = tmp_path / "any.mcap", random.Random(11)
    write_recording(path, 4)
    content = path.read_bytes()
    for _ in range(60):
        damaged = bytearray(content)
        for _ in range(rng.choice((1, 5, 50))):
            damaged[rng.randrange(8, len(damaged))] = rng.choice((0, 255, rng.randrange(256)))
        path.write_bytes(damaged[: rng.randrange(100, len(damaged))])
        try:
            with Recording(path) as recording:
                list(recording.entries(Damage()))
                recording.sum_is_right()
        except RecordingError:
            continue


def test_a_hostile_session_or_clock_is_left_out(tmp_path: Path) -> None:
    lies = {"session": "1", "device_id": "zz", "boot_id": "-1", "calibration_hash": "", "capabilities": "x"}
    texts = Metadata("session", described({**lies, "version": "1", "host_us": "0"}))
    with Recording(_file(tmp_path / "one.mcap", texts, Metadata("session", {"session": "1"}), DataEnd(0))) as recording:
        assert recording.sessions == {}
        assert recording.damaged_texts == 2
    for bad in (b"{", b"[" * 100_000, b'{"offset_us":1e308}', b'{"offset_us":1,"skew_ppm":-1e6,"bound_us":1}'):
        assert read_note(bad, ClockNote) is None
    with replay(_file(tmp_path / "two.mcap", DataEnd(0)), pace=None) as camera:
        assert list(camera) == []


def test_texts_come_back_only_as_they_were_written() -> None:
    texts = described({"label": "box", "number": 3})
    assert undescribed(texts) == {"label": "box", "number": "3"}
    assert undescribed({**texts, "label": "fox"}) is None
    assert undescribed({}) is None
    assert SessionNote(1, "00" * 8, 7, "00" * 8, 1, 1, 0).boot_id == 7


NAMES = [
    "../secret.mcap",
    "/etc/passwd",
    "a\0b.mcap",
    "CON.mcap",
    "x" * 300 + ".mcap",
    "link.mcap",
    "\uff0e\uff0e/secret.mcap",
    ".hidden.mcap",
    "recording",
    "",
    "sub/inside.mcap",
    "20260101-000000-00.mcap ",
]


@pytest.mark.parametrize("name", NAMES)
def test_no_name_leads_out_of_the_folder_of_recordings(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.mcap").write_bytes(b"not yours")
    folder = RecordingFolder(tmp_path / "root")
    (folder.root / "link.mcap").symlink_to(tmp_path / "secret.mcap")
    (folder.root / "sub").mkdir()
    (folder.root / "sub" / "inside.mcap").write_bytes(b"")
    with pytest.raises(UsageError, match=r"is no name of a recording|there is no recording"):
        folder.path(name)
    assert folder.names() == []


def test_a_recording_never_writes_through_a_link_or_over_a_file(tmp_path: Path) -> None:
    (tmp_path / "mine").write_bytes(b"mine")
    (tmp_path / "link.mcap").symlink_to(tmp_path / "mine")
    (tmp_path / "dangling.mcap").symlink_to(tmp_path / "not-made")
    for name in ("mine", "link.mcap", "dangling.mcap"):
        with pytest.raises(RecordingError, match="a name that is not taken"):
            FileOutput(tmp_path / name)
    assert (tmp_path / "mine").read_bytes() == b"mine"
    assert not (tmp_path / "not-made").exists()


def test_recordings_of_one_second_have_names_of_their_own(tmp_path: Path) -> None:
    folder = RecordingFolder(tmp_path / "new" / "root")
    made = [folder.create(b"serial-1") for _ in range(3)]
    for _, output in made:
        output.close()
    assert len({path.name for path, _ in made}) == 3
    assert folder.names() == sorted(path.name for path, _ in made)
    assert folder.path(made[0][0].name) == made[0][0]
