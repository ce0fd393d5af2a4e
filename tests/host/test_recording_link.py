from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from host.counting import CALIBRATION, Counting, disparity, serve
from host.recorded import FRAME_US, NAMED, begin, frame_packets, session_note, write_recording
from prismstereo.clock import ClockMapping
from prismstereo.driver import StereoCamera
from prismstereo.events import EventKind
from prismstereo.recording import Recorder, RecordingLink, no_other, replay
from prismstereo.recording.output import FileOutput
from prismstereo.recording.verification import verify
from prismstereo_device.link import LinkLost
from prismstereo_device.link.loopback import loopback
from prismstereo_device.protocol import calibration_hash
from prismstereo_hw.errors import DataError, UsageError


def test_a_recording_replays_every_frame_bit_by_bit_through_the_same_driver(tmp_path: Path) -> None:
    near, far = loopback()
    with (
        serve(Counting(60, period_s=0.002), near, lossless=True),
        StereoCamera(far, keep_all=True) as camera,
        Recorder(camera, tmp_path) as recorder,
    ):
        live = {frame.index: frame for frame in camera}
    with replay(recorder.path, pace=None, keep_all=True) as camera:
        again = list(camera)
        assert camera.calibration_bytes == CALIBRATION
        assert camera.identity.device_id == b"serial-1"
        assert (camera.statistics.partial, camera.statistics.lost, camera.statistics.not_taken) == (0, 0, 0)
    assert [frame.index for frame in again] == list(range(again[0].index, 60))
    assert len(again) >= 30  # what came before the recorder was there is not in it
    for frame in again:
        seen = live[frame.index]
        assert frame.disparity.disparity_px.tobytes() == seen.disparity.disparity_px.tobytes()
        assert (frame.timestamp_us, frame.disparity.window) == (seen.timestamp_us, seen.disparity.window)
    found = verify(recorder.path)
    assert (found.frames, found.identical, found.whole) == (len(again), len(again), True)


def test_a_plain_camera_on_a_recording_is_the_same_object(tmp_path: Path) -> None:
    write_recording(tmp_path / "one.mcap", 10)
    with StereoCamera(RecordingLink(tmp_path / "one.mcap", pace=None), keep_all=True) as camera:
        for index, frame in enumerate(camera):
            np.testing.assert_array_equal(frame.disparity.disparity_px, disparity(index).disparity_px)
        assert camera.identity_details == {"serial": "serial-1"}
        with pytest.raises(UsageError, match="takes no commands"):
            camera.set("rate_hz", 10.0)
    assert index == 9


def test_a_replay_takes_as_long_as_the_recording_did(tmp_path: Path) -> None:
    write_recording(tmp_path / "one.mcap", 7)
    begin_s = time.monotonic()
    with replay(tmp_path / "one.mcap", keep_all=True) as camera:
        assert len(list(camera)) == 7
    assert time.monotonic() - begin_s == pytest.approx(6 * FRAME_US * 1e-6, abs=0.3)


def test_a_slow_reader_that_keeps_all_loses_nothing(tmp_path: Path) -> None:
    write_recording(tmp_path / "one.mcap", 30)
    with replay(tmp_path / "one.mcap", pace=100.0, queue_frames=2, keep_all=True) as camera:
        time.sleep(0.3)
        assert camera.statistics.frames <= 2 + 3
        assert [frame.index for frame in camera] == list(range(30))


def test_the_clock_of_a_replay_takes_stamps_to_the_moment_at_which_they_are_shown(tmp_path: Path) -> None:
    journal = begin(FileOutput(tmp_path / "one.mcap"))
    first_us = time.monotonic_ns() // 1000
    journal.sync(ClockMapping(offset_us=first_us, skew_ppm=0.0, bound_us=100.0, at_device_us=0))
    for index in range(9):
        for packet in frame_packets(index, at_us=first_us + 50_000 * index):
            journal.write(packet)
    journal.finish()
    with replay(tmp_path / "one.mcap", keep_all=True) as camera:
        frames = iter(camera)
        begun_us = time.monotonic_ns() // 1000
        assert next(frames).index == 0
        last = list(frames)[-1]
        clock = camera.clock
        assert clock is not None
        assert clock.host_time_us(last.timestamp_us) - begun_us == pytest.approx(last.timestamp_us, abs=200_000)


def _two_boots(path: Path) -> None:
    """Ten frames, a reboot that begins to count anew and has another calibration, ten frames."""
    journal = begin(FileOutput(path))
    for index in range(10):
        for packet in frame_packets(index, at_us=FRAME_US * index):
            journal.write(packet)
    journal.calibrate(b"another")
    journal.write(session_note(2, boot_id=78, content=b"another"))
    for index in range(10):
        named = calibration_hash(b"another")
        for packet in frame_packets(index, at_us=FRAME_US * (50 + index), session=2, named=named):
            journal.write(packet)
    journal.finish()


def test_a_reboot_in_a_recording_is_a_reboot_in_its_replay(tmp_path: Path) -> None:
    _two_boots(tmp_path / "two.mcap")
    kinds: list[EventKind] = []
    with replay(tmp_path / "two.mcap", pace=None, keep_all=True) as camera:
        camera.on_event.append(lambda event: kinds.append(event.kind))
        frames = list(camera)
        assert camera.calibration_bytes == b"another"
    assert [(frame.session, frame.index) for frame in frames] == [(1, i) for i in range(10)] + [
        (2, i) for i in range(10)
    ]
    assert frames[0].calibration_hash == NAMED[:4]
    assert EventKind.REBOOTED in kinds
    found = verify(tmp_path / "two.mcap")
    assert (found.frames, found.identical, found.sessions, found.lost) == (20, 20, 2, 0)


def test_a_damaged_packet_makes_a_partial_frame_and_no_wrong_pixel(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    packets = write_recording(path, 12)
    content = bytearray(path.read_bytes())
    victim = next(packet for packet in packets if packet.packet.msg == 5 and packet.packet.frag == 4)
    content[content.index(victim.packet.payload) + 20] ^= 1
    path.write_bytes(content)
    with replay(path, pace=None, keep_all=True) as camera:
        frames = list(camera)
    assert [frame.index for frame in frames if frame.partial] == [5]
    for frame in frames:
        rows = np.ones(96, bool) if frame.lost_rows is None else ~frame.lost_rows
        sent = disparity(frame.index).disparity_px
        np.testing.assert_array_equal(frame.disparity.disparity_px[rows], sent[rows])
    found = verify(path)
    assert (found.damage.packets, found.partial, found.identical, found.whole) == (1, 1, 12, False)


def test_a_replay_can_be_paused_and_moved(tmp_path: Path) -> None:
    write_recording(tmp_path / "one.mcap", 60)
    link = RecordingLink(tmp_path / "one.mcap", pace=40.0, stay=True)
    with StereoCamera(link, reopen=no_other, keep_all=True) as camera:
        frames = iter(camera)
        while next(frames).index < 59:
            pass
        link.seek(30 * FRAME_US * 1e-6)
        frame = next(frames)
        assert (frame.session, frame.index) == (2, 30)
        link.pause()
        time.sleep(0.1)
        here_s = link.position_s
        time.sleep(0.2)
        assert link.position_s == here_s
        link.resume()
        assert [next(frames).index for _ in range(29)] == list(range(31, 60))
    with replay(tmp_path / "one.mcap", pace=None, start_s=50 * FRAME_US * 1e-6, keep_all=True) as camera:
        assert [frame.index for frame in camera] == list(range(50, 60))


def test_a_recording_without_the_calibration_says_so(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    write_recording(path, 5)
    content = bytearray(path.read_bytes())
    content[content.index(CALIBRATION) + 7] ^= 1
    path.write_bytes(content)
    with replay(path, pace=None, keep_all=True) as camera:
        frames = list(camera)
        with pytest.raises(DataError, match="no such object"):
            camera.depth(frames[0])
    assert not verify(path).whole


def test_a_closed_recording_is_a_lost_link(tmp_path: Path) -> None:
    write_recording(tmp_path / "one.mcap", 3)
    link = RecordingLink(tmp_path / "one.mcap")
    link.close()
    link.close()
    with pytest.raises(LinkLost, match="is closed"):
        link.read(0.0)
    with pytest.raises(UsageError, match="a pace of -1"):
        RecordingLink(tmp_path / "one.mcap", pace=-1.0)
