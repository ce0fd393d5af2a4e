from __future__ import annotations

import random
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from host.counting import CALIBRATION, Counting, serve
from host.recorded import begin, cut_while_writing, frame_packets, session_note, write_recording
from host.recording_disk import ModelDisk
from prismstereo.driver import StereoCamera
from prismstereo.recording import Damage, Recorder, Recording, RecordingError, recover
from prismstereo.recording.notes import EventNote
from prismstereo.recording.outline import RECORD_LIMIT
from prismstereo.recording.stored_packet import StoredPacket
from prismstereo_device.link.loopback import loopback
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DataError, UsageError


def test_a_recording_is_accepted_by_the_independent_reader_with_every_packet_in_it(tmp_path: Path) -> None:
    packets = write_recording(tmp_path / "one.mcap", 40)
    with (tmp_path / "one.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        found = [message.data for _, _, message in reader.iter_messages(topics="/prismstereo/packets")]
        attached = {attachment.name: attachment.data for attachment in reader.iter_attachments()}
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(packets)
    assert found == [packet.pack() for packet in packets]
    assert sorted(attached) == ["calibration-0d2ec04c15a346a3.bin", "identity.json"]
    assert attached["calibration-0d2ec04c15a346a3.bin"] == CALIBRATION


def test_what_was_written_is_read_again(tmp_path: Path) -> None:
    packets = write_recording(tmp_path / "one.mcap", 20)
    with Recording(tmp_path / "one.mcap") as recording:
        assert list(recording.packets()) == packets
        assert (recording.info["label"], recording.identity) == ("of a test", b'{"serial":"serial-1"}')
        assert [one.content for one in recording.calibrations] == [CALIBRATION]
        assert recording.sessions == {1: session_note()}
        assert (recording.finished, recording.why_cut, recording.sum_is_right()) == (True, "", True)
        np.testing.assert_allclose(recording.length_s, 19 * 0.066667, atol=1e-6)


@pytest.mark.parametrize("runs", [10, pytest.param(150, marks=pytest.mark.soak)])
def test_a_power_cut_loses_no_synced_packet_and_makes_no_wrong_one(tmp_path: Path, runs: int) -> None:
    lost_most = 0
    for run in range(runs):
        written, safe, left = cut_while_writing(tmp_path / "cut.mcap", random.Random(run))
        assert left == written[: len(left)], f"run {run}: what is left is not what was written"
        assert len(left) >= safe, f"run {run}: {len(left)} of {safe} synced packets are left"
        lost_most = max(lost_most, len(written) - len(left))
    assert lost_most <= 3 * 15, f"{lost_most / 3:.0f} frames at 15 Hz were lost"
    if runs > 10:
        print(f"{runs} power cuts: 0 synced packets lost, at most {lost_most / 45:.2f} s behind the last sync")


@pytest.mark.parametrize("finished", [True, False])
def test_every_flipped_bit_is_noticed_and_none_makes_a_wrong_packet(tmp_path: Path, finished: bool) -> None:
    path, rng = tmp_path / "one.mcap", random.Random(7)
    packets = set(write_recording(path, 20, finished=finished))
    content = path.read_bytes()
    with Recording(path) as recording:
        chunks = [chunk.place for chunk in recording.outline.chunks]
        end = recording.outline.data_end
    noticed = 0
    for _ in range(60):
        place = rng.choice(chunks)
        position = rng.randrange(8, end) if finished else rng.randrange(place.begin + 32, place.begin + place.length)
        damaged = bytearray(content)
        damaged[position] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        noticed += _notices(path, packets)
    assert noticed == 60


def _notices(path: Path, packets: set[StoredPacket]) -> bool:
    damage = Damage()
    try:
        with Recording(path) as recording:
            found = list(recording.packets(damage))
            wrong_sum = recording.sum_is_right() is False
            texts = recording.damaged_texts or recording.outline.damaged or recording.why_cut
    except RecordingError:
        return True
    assert packets.issuperset(found)
    return bool(damage.any or wrong_sum or texts or len(found) < len(packets))


def test_a_flipped_bit_costs_one_packet_of_its_chunk(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    packets = write_recording(path, 20)
    content = bytearray(path.read_bytes())
    content[content.index(packets[50].packet.payload) + 10] ^= 4
    path.write_bytes(content)
    damage = Damage()
    with Recording(path) as recording:
        assert list(recording.packets(damage)) == packets[:50] + packets[51:]
        assert recording.sum_is_right() is False
    assert (damage.packets, damage.chunks) == (1, 1)


@pytest.mark.parametrize("runs", [3, pytest.param(30, marks=pytest.mark.soak)])
def test_a_disk_that_gets_full_ends_the_recording_in_good_order_and_says_so(tmp_path: Path, runs: int) -> None:
    rng, worst_s = random.Random(3), 0.0
    for run in range(runs):
        disk = ModelDisk(room=rng.randrange(1_200_000, 4_000_000 if runs > 3 else 1_800_000))
        near, far = loopback()
        with serve(Counting(900, period_s=0.004), near, lossless=True), StereoCamera(far) as camera:
            recorder = Recorder(camera, tmp_path, output=disk, views_hz=0)
            assert recorder.wait(20)
            failed_us = time.monotonic_ns() // 1000
            assert "No space left on device" in recorder.reason
            recorder.stop()
        assert disk.closed
        (tmp_path / "full.mcap").write_bytes(disk.content)
        with Recording(tmp_path / "full.mcap") as recording:
            damage = Damage()
            found = list(recording.packets(damage))
            assert not damage.any, f"run {run}"
            worst_s = max(worst_s, (failed_us - found[-1].host_us) * 1e-6)
    assert worst_s <= 1.0, f"{worst_s:.2f} s before the failure are lost"
    if runs > 3:
        print(f"{runs} full disks: every file opens, at most {worst_s:.2f} s before the failure are lost")


def test_a_disk_with_too_little_left_ends_the_recording_before_it_is_full(tmp_path: Path) -> None:
    disk = ModelDisk(free=600_000_000)
    near, far = loopback()
    with serve(Counting(4000, period_s=0.004), near), StereoCamera(far) as camera:
        with Recorder(camera, tmp_path, output=disk, views_hz=0) as recorder:
            disk.free = 499_000_000
            assert recorder.wait(10)
            assert "499 MB are left" in recorder.reason
        with pytest.raises(RecordingError, match="499 MB are left on the disk"):
            Recorder(camera, tmp_path, output=disk)
        with Recorder(camera, tmp_path, output=ModelDisk(free=1), least_free_bytes=0) as recorder:
            assert not recorder.wait(0.1)
        assert camera.on_packet == []
    (tmp_path / "low.mcap").write_bytes(disk.content)
    with Recording(tmp_path / "low.mcap") as recording:
        assert recording.finished
        assert recording.sum_is_right()


def test_a_slow_disk_costs_packets_that_are_counted_and_never_the_stream(tmp_path: Path) -> None:
    class Slow(ModelDisk):
        def sync(self) -> None:
            time.sleep(0.3)
            super().sync()

    near, far = loopback()
    with serve(Counting(300, period_s=0.004), near, lossless=True), StereoCamera(far, keep_all=True) as camera:
        with Recorder(camera, tmp_path, output=(disk := Slow()), views_hz=0, queue_bytes=60_000) as recorder:
            assert len(list(camera)) == 300
        dropped = recorder.statistics.dropped
        assert dropped > 0
        assert recorder.reason == ""
    (tmp_path / "slow.mcap").write_bytes(disk.content)
    with Recording(tmp_path / "slow.mcap") as recording:
        told = sum(entry.count for _, entry in recording.entries() if isinstance(entry, EventNote))
        packets = len(list(recording.packets()))
    assert told == dropped
    assert packets == recorder.statistics.packets


def test_a_cut_recording_is_made_whole_and_nothing_is_overwritten(tmp_path: Path) -> None:
    packets = write_recording(tmp_path / "whole.mcap", 60)
    content = (tmp_path / "whole.mcap").read_bytes()
    cut_at = content.index(packets[200].packet.payload) + 10
    (tmp_path / "cut.mcap").write_bytes(content[:cut_at])
    done = recover(tmp_path / "cut.mcap", tmp_path / "mended.mcap")
    assert done.packets == 200
    assert "has" in done.why_cut
    with Recording(tmp_path / "mended.mcap") as mended:
        assert list(mended.packets()) == packets[:200]
        assert (mended.finished, mended.sum_is_right(), mended.info["label"]) == (True, True, "of a test")
        assert [one.content for one in mended.calibrations] == [CALIBRATION]
    with (tmp_path / "mended.mcap").open("rb") as file:
        assert len(list(make_reader(file, validate_crcs=True).iter_messages(topics="/prismstereo/packets"))) == 200
    with pytest.raises(RecordingError, match="give a name that is not taken"):
        recover(tmp_path / "cut.mcap", tmp_path / "mended.mcap")
    assert (tmp_path / "cut.mcap").read_bytes() == content[:cut_at]
    with pytest.raises(RecordingError, match="does not begin as an MCAP file"):
        recover(__file__, tmp_path / "new.mcap")
    assert not (tmp_path / "new.mcap").exists()


def test_a_label_is_kept_inside_and_one_that_is_too_long_is_refused(tmp_path: Path) -> None:
    near, far = loopback()
    with serve(Counting(40, period_s=0.004), near, lossless=True), StereoCamera(far) as camera:
        with Recorder(camera, tmp_path, label="../../etc") as recorder:
            list(camera)
        assert recorder.path.parent == tmp_path
        assert recorder.path.name.endswith("-73657269616c2d31.mcap")
        with Recording(recorder.path) as recording:
            assert recording.info["label"] == "../../etc"
        with pytest.raises(UsageError, match="201 characters"):
            Recorder(camera, tmp_path, label="x" * 201)


def test_objects_on_the_line_are_kept_whole_and_not_in_parts(tmp_path: Path) -> None:
    near, far = loopback()
    with serve(Counting(100, period_s=0.004), near, lossless=True), StereoCamera(far) as camera:
        bulk: list[int] = []
        camera.on_packet.append(lambda packet, _, __: bulk.append(packet.channel))
        with Recorder(camera, tmp_path) as recorder, pytest.raises(DataError, match="no such object"):
            _ = camera.identity_details
    assert Channel.BULK in bulk
    with Recording(recorder.path) as recording:
        assert Channel.BULK not in {packet.packet.channel for packet in recording.packets()}


def test_messages_wait_for_no_more_than_a_mebibyte() -> None:
    disk = ModelDisk()
    journal = begin(disk)
    before = len(disk.content)
    for index in range(150):
        for packet in frame_packets(index, at_us=index):
            journal.write(packet)
    assert len(disk.content) - before > 1 << 20
    assert journal.size < RECORD_LIMIT
    journal.leave()
