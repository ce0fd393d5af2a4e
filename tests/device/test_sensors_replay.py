"""Recorded frames behind the interface of a camera: sessions, videos, pictures, their times and their stills."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from prismstereo_device.sensors import Sensor, open_sensor
from prismstereo_device.sensors.base import StampQuality
from prismstereo_device.sensors.replay import ReplaySensor
from prismstereo_hw.errors import ImageError, SessionError, UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import named
from prismstereo_hw.session import SessionWriter
from prismstereo_hw.twin import Twin


def everything(sensor: Sensor) -> list[RawFrame]:
    frames = list(iter(sensor.read, None))
    sensor.close()
    return [frame for frame in frames if frame is not None]


@pytest.fixture
def session(tmp_path: Path, small: Rig) -> Path:
    folder = tmp_path / "session"
    writer, twin = SessionWriter(folder, small), Twin(small, named(small, "desk"))
    for index in (0, 1, 5):
        writer.add("video", twin.frame(index))
    writer.finish()
    return folder


def test_a_session_is_replayed_with_its_times_and_its_rig(session: Path, small: Rig) -> None:
    sensor = open_sensor(f"replay:{session}")
    assert sensor.rig == small
    frames = everything(sensor)
    assert [(frame.index, frame.timestamp_us) for frame in frames] == [(0, 0), (1, 33_333), (5, 166_667)]
    assert sensor.read() is None


def test_only_as_many_frames_are_given_as_asked_for(session: Path) -> None:
    assert len(everything(open_sensor(f"replay:{session}", frames=2))) == 2
    assert everything(open_sensor(f"replay:{session}", frames=0)) == []


def test_a_folder_of_pictures_is_replayed_in_order_of_names(tmp_path: Path, rng: np.random.Generator) -> None:
    pictures = rng.integers(0, 256, (3, 60, 80), np.uint8)
    for name, picture in zip(("c.png", "a.bmp", "b.PGM"), pictures, strict=True):
        cv2.imwrite(str(tmp_path / name.lower()), picture)
        (tmp_path / name.lower()).rename(tmp_path / name)
    (tmp_path / "notes.txt").write_text("not a picture")
    frames = everything(ReplaySensor(tmp_path))
    for frame, index in zip(frames, (1, 2, 0), strict=True):
        np.testing.assert_array_equal(frame.pixels, pictures[index])
    assert [frame.timestamp_us for frame in frames] == [0, 33_333, 66_667]
    assert ReplaySensor(tmp_path).rig is None


def test_one_picture_is_one_frame(tmp_path: Path, rng: np.random.Generator) -> None:
    picture = rng.integers(0, 256, (60, 80, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "one.png"), picture)
    (frame,) = everything(open_sensor(f"replay:{tmp_path / 'one.png'}"))
    np.testing.assert_array_equal(frame.pixels, picture)


def test_a_damaged_picture_is_an_error_when_its_turn_comes(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((60, 80), np.uint8))
    (tmp_path / "1.png").write_bytes(b"")
    sensor = ReplaySensor(tmp_path)
    assert sensor.read() is not None
    with pytest.raises(ImageError, match=r"1\.png is cut off or empty"):
        sensor.read()


@pytest.mark.parametrize("path", ["missing", "empty", "a" * 5000])
def test_there_must_be_something_to_replay(tmp_path: Path, path: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(
        ImageError,
        match=r"there is nothing to replay at .*: give a session folder, a folder of pictures, a picture or a video",
    ):
        open_sensor(f"replay:{tmp_path / path}")


def test_a_session_without_video_has_nothing_to_replay(tmp_path: Path, small: Rig) -> None:
    SessionWriter(tmp_path / "still", small).finish()
    with pytest.raises(SessionError, match="holds no video frames: there is nothing to replay"):
        open_sensor(f"replay:{tmp_path / 'still'}")


def test_a_session_that_lost_frames_is_refused_at_once(session: Path) -> None:
    (session / "video" / "000001.png").unlink()
    with pytest.raises(SessionError, match="holds 2 of the 3 pictures"):
        open_sensor(f"replay:{session}")


# ---- videos


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Five frames, 40 ms apart, without loss: the n-th is 40 n bright."""
    path = tmp_path / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (64, 48))
    for index in range(5):
        writer.write(np.full((48, 64, 3), 40 * index, np.uint8))
    writer.release()
    return path


def test_a_video_is_replayed_with_the_times_of_its_container(video: Path) -> None:
    sensor = open_sensor(f"replay:{video}")
    assert sensor.stamp_quality is StampQuality.MADE
    assert [(mode.width, mode.height, mode.rate_hz) for mode in sensor.modes] == [(64, 48, 25.0)]
    frames = everything(sensor)
    assert [(frame.index, frame.timestamp_us) for frame in frames] == [(n, 40_000 * n) for n in range(5)]
    assert [int(frame.pixels[7, 9, 0]) for frame in frames] == [0, 40, 80, 120, 160]


def test_a_recorded_video_keeps_every_frame(data: Path) -> None:
    sensor = open_sensor(f"replay:{data / 'calib-charuco-2cam' / 'cam_0.mp4'}", frames=7)
    frames = everything(sensor)
    assert [frame.timestamp_us for frame in frames] == [round(n * 1e6 / 6) for n in range(7)]
    assert frames[6].pixels.shape == (720, 1280, 3)


@pytest.mark.parametrize("kept", [0, 100, 300])
def test_a_video_that_is_cut_off_is_refused_by_name(video: Path, kept: int) -> None:
    video.write_bytes(video.read_bytes()[:kept])
    with pytest.raises(ImageError, match=r"video\.avi is no video that can be read: it is cut off"):
        open_sensor(f"replay:{video}")


def test_a_recording_of_packets_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"run\.MCAP is an MCAP recording: .* give a session or a video"):
        open_sensor(f"replay:{tmp_path / 'run.MCAP'}")


# ---- turns and pace


def test_a_loop_goes_on_with_indexes_and_times(video: Path, session: Path) -> None:
    frames = everything(open_sensor(f"replay:{video}?loop=1", frames=12))
    assert [(frame.index, frame.timestamp_us) for frame in frames] == [(n, 40_000 * n) for n in range(12)]
    assert [int(frame.pixels[0, 0, 0]) for frame in frames[4:7]] == [160, 0, 40]
    frames = everything(open_sensor(f"replay:{session}?loop=1", frames=5))
    assert [frame.index for frame in frames] == [0, 1, 5, 6, 7]
    assert [frame.timestamp_us for frame in frames] == [0, 33_333, 166_667, 250_001, 283_334]  # a mean period later


def test_one_picture_can_be_looked_at_for_ever(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "one.png"), np.full((60, 80), 7, np.uint8))
    frames = everything(open_sensor(f"replay:{tmp_path / 'one.png'}?loop=1", frames=3))
    assert [(frame.index, frame.timestamp_us) for frame in frames] == [(0, 0), (1, 33_333), (2, 66_666)]


def test_a_question_mark_may_be_part_of_a_name(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "one?.png"), np.full((60, 80), 7, np.uint8))
    assert len(everything(open_sensor(f"replay:{tmp_path / 'one?.png'}"))) == 1


def test_the_recorded_pace_is_kept_until_another_rate_is_set(video: Path) -> None:
    sensor = open_sensor(f"replay:{video}?pace=recorded")
    begin_s = time.monotonic()
    for _ in range(3):
        assert sensor.read() is not None
    assert 0.08 - 1e-3 <= time.monotonic() - begin_s < 1.0
    sensor.set_rate(1000.0)
    assert sensor.read() is not None
    with pytest.raises(UsageError, match=r"rate_hz 2000: this camera takes 0\.01 to 1000"):
        sensor.set_rate(2000.0)
    sensor.close()


def test_the_slower_of_two_rates_counts(video: Path) -> None:
    sensor = open_sensor(f"replay:{video}?rate=25", rate_hz=1000.0)
    begin_s = time.monotonic()
    assert len(everything(sensor)) == 5
    assert time.monotonic() - begin_s >= 0.16 - 1e-3


def test_a_rig_can_be_named_for_frames_that_know_none(video: Path, oak: Rig) -> None:
    sensor = open_sensor(f"replay:{video}?rig=oak-1")
    assert sensor.rig == oak
    sensor.close()


# ---- stills of a session


@pytest.fixture
def still_session(tmp_path: Path, small: Rig) -> Path:
    """Video frames at 0, 100 and 200 ms, stills (10, 110 and 210 bright) at 20, 120 and 190 ms."""
    folder = tmp_path / "stills"
    writer = SessionWriter(folder, small)
    for index in range(3):
        writer.add("video", RawFrame(np.full((180, 320), index, np.uint8), index, 100_000 * index))
    for index, stamp_us in enumerate((20_000, 120_000, 190_000)):
        writer.add("stills", RawFrame(np.full((480, 640), 10 + 100 * index, np.uint8), index, stamp_us))
    writer.finish()
    return folder


def test_a_still_is_the_recorded_one_nearest_to_the_newest_frame(still_session: Path) -> None:
    sensor = open_sensor(f"replay:{still_session}?loop=1")
    with pytest.raises(UsageError, match="a still belongs to a video frame: read one first"):
        sensor.still()
    found = []
    for _ in range(5):
        assert sensor.read() is not None
        still = sensor.still()
        found.append((still.frame.index, still.frame.timestamp_us, int(still.frame.pixels[0, 0])))
        assert still.crop == (0, 0, 640, 480)
    assert found == [(0, 20_000, 10), (1, 120_000, 110), (2, 190_000, 210), (3, 320_000, 10), (4, 420_000, 110)]
    sensor.close()


def test_a_recording_without_stills_takes_none(video: Path) -> None:
    sensor = open_sensor(f"replay:{video}")
    assert sensor.read() is not None
    with pytest.raises(UsageError, match="this recording holds no stills"):
        sensor.still()
    sensor.close()
