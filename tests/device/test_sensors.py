"""Sensors: the twin and recorded frames behind the interface of a camera."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from prismstereo_device.sensors import SENSORS, Sensor, open_sensor
from prismstereo_device.sensors.base import Pace
from prismstereo_device.sensors.replay import ReplaySensor
from prismstereo_device.sensors.twin import TwinSensor
from prismstereo_hw.errors import ImageError, RigError, SessionError, UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import named
from prismstereo_hw.session import SessionWriter
from prismstereo_hw.twin import Twin


@pytest.fixture
def rig_file(tmp_path: Path, small: Rig) -> Path:
    """A rig with few pixels, as a file."""
    path = tmp_path / "small.toml"
    path.write_text(small.toml())
    return path


def everything(sensor: Sensor) -> list[RawFrame]:
    frames = list(iter(sensor.read, None))
    sensor.close()
    return [frame for frame in frames if frame is not None]


# ---- the twin


def test_the_twin_exposes_frame_after_frame_at_the_rate_of_its_clock(small: Rig) -> None:
    frames = everything(TwinSensor(Twin(small, named(small, "desk")), frames=3))
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert [frame.timestamp_us for frame in frames] == [0, 33_333, 66_667]
    np.testing.assert_array_equal(frames[1].pixels, Twin(small, named(small, "desk")).frame(1).pixels)


def test_the_twin_knows_what_stands_in_front_of_it(small: Rig) -> None:
    sensor = TwinSensor(Twin(small, named(small, "desk")), frames=0)
    assert sensor.rig == small
    assert sensor.read() is None


@pytest.mark.parametrize(
    ("argument", "scene"),
    [("oak-1", "desk"), ("oak-1:", "desk"), ("oak-1:plane:500", "plane:500"), ("dslr-35mm:board:900", "board:900")],
)
def test_a_twin_is_named_by_rig_and_scene(argument: str, scene: str) -> None:
    sensor = open_sensor(f"twin:{argument}")
    assert isinstance(sensor, TwinSensor)
    assert sensor.twin.scene.name == scene
    assert sensor.rig is not None
    assert sensor.rig.name == argument.partition(":")[0]


@pytest.mark.parametrize("scene", ["", ":desk", ":plane:700"])
def test_a_twin_is_made_of_a_rig_file(rig_file: Path, scene: str) -> None:
    sensor = open_sensor(f"twin:{rig_file}{scene}", frames=1)
    assert isinstance(sensor, TwinSensor)
    assert sensor.twin.scene.name == (scene[1:] or "desk")
    assert len(everything(sensor)) == 1


def test_a_rig_file_may_lie_in_a_folder_with_a_colon(tmp_path: Path, small: Rig) -> None:
    folder = tmp_path / "odd:name.toml.d"
    folder.mkdir()
    (folder / "rig.toml").write_text(small.toml())
    sensor = open_sensor(f"twin:{folder}/rig.toml:plane:700", frames=0)
    assert isinstance(sensor, TwinSensor)
    assert sensor.twin.scene.name == "plane:700"


# ---- recorded frames


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
        ImageError, match=r"there is nothing to replay at .*: give a session folder, a folder of pictures"
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


# ---- addresses and pace


@pytest.mark.parametrize("address", ["", "twin", "twin:", "replay:", "webcam:0", "TWIN:oak-1", ":"])
def test_an_unknown_address_is_refused_with_the_kinds_there_are(address: str) -> None:
    with pytest.raises(UsageError, match=r"there is no sensor .*: give twin:RIG\[:SCENE\] or replay:PATH") as caught:
        open_sensor(address)
    assert all(kind in str(caught.value) for kind in SENSORS)


def test_an_unknown_rig_or_scene_is_refused_by_its_own_rule() -> None:
    with pytest.raises(RigError, match="there is no rig 'oak-2'"):
        open_sensor("twin:oak-2")
    with pytest.raises(RigError, match=r"there is no rig 'missing\.toml'"):
        open_sensor("twin:missing.toml:desk")
    with pytest.raises(UsageError, match="there is no scene 'garden'"):
        open_sensor("twin:oak-1:garden")


@pytest.mark.parametrize("rate_hz", [0.0, -30.0, float("nan"), float("inf")])
def test_an_impossible_rate_is_refused(rate_hz: float) -> None:
    with pytest.raises(UsageError, match=r"a rate of .* frames per second: give a positive one, or none for no limit"):
        open_sensor("twin:oak-1", rate_hz=rate_hz)


def test_a_negative_number_of_frames_is_refused() -> None:
    with pytest.raises(UsageError, match="-1 frames: give 0 or more, or none for all there are"):
        open_sensor("twin:oak-1", frames=-1)


def test_a_pace_is_kept_and_a_late_source_is_not_hurried() -> None:
    pace = Pace(50.0)
    begin = time.monotonic()
    for _ in range(4):
        pace.wait()
    assert time.monotonic() - begin >= 0.06 - 1e-3  # the first at once, the others 20 ms apart
    time.sleep(0.1)
    late = time.monotonic()
    pace.wait()
    at_once = time.monotonic()
    pace.wait()
    assert at_once - late < 0.015
    assert time.monotonic() - late >= 0.02 - 1e-3  # no burst to catch up


def test_without_a_pace_nobody_waits() -> None:
    begin = time.monotonic()
    pace = Pace(None)
    for _ in range(1000):
        pace.wait()
    assert time.monotonic() - begin < 0.1
