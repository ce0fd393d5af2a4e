"""Sensors: the twin behind the interface of a camera, addresses, options, pace."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from prismstereo_device.sensors import SENSORS, Sensor, open_sensor
from prismstereo_device.sensors.base import Pace
from prismstereo_device.sensors.options import Options
from prismstereo_device.sensors.twin import TwinSensor
from prismstereo_hw.errors import RigError, UsageError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import named
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


# ---- addresses and pace


@pytest.mark.parametrize(
    "address", ["", "twin", "twin:", "replay:", "v4l2:", "url:", "webcam:0", "TWIN:oak-1", ":", "picamera2", "oak"]
)
def test_an_unknown_address_is_refused_with_the_kinds_there_are(address: str) -> None:
    with pytest.raises(UsageError, match=r"there is no sensor .*: give twin:RIG\[:SCENE\] or replay:PATH") as caught:
        open_sensor(address)
    assert all(kind in str(caught.value) for kind in SENSORS)


def test_a_password_in_an_address_that_is_wrong_is_not_said() -> None:
    with pytest.raises(UsageError, match="there is no sensor 'rtsp:': give") as caught:
        open_sensor("rtsp://user:secret@192.168.1.20/stream")
    assert "secret" not in str(caught.value)


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


# ---- options


def test_options_are_read_by_name_and_kind() -> None:
    name, options = Options.behind("/dev/video0?width=1280&rate=29.97&colour=0", ("width", "rate", "colour", "gain"))
    assert name == "/dev/video0"
    assert options.whole("width") == 1280
    assert options.number("rate") == 29.97
    assert options.flag("colour", default=True) is False
    assert options.number("gain") is None
    assert Options("", ("width",)).whole("width") is None


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("wide=3", "there is no option 'wide' of this sensor: give width, rate"),
        ("width=3&width=4", "given twice"),
        ("width", "not KEY=VALUE&KEY=VALUE"),
        ("width=0", "width=0: give a whole number from 1"),
        ("width=²", "width=²: give a whole number from 1"),
        ("width=99999999999999999999999999", "give a whole number from 1"),
        ("rate=nan", "rate=nan: give a positive number"),
        ("rate=-3", "rate=-3: give a positive number"),
        ("rate=inf", "rate=inf: give a positive number"),
        ("rate=" + "9" * 5000, "at most 4096"),
    ],
)
def test_an_option_that_cannot_be_is_refused(text: str, complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        _ = (options := Options(text, ("width", "rate"))).whole("width"), options.number("rate")


def test_a_choice_and_a_flag_take_their_words_only() -> None:
    options = Options("pace=quick&loop=perhaps", ("pace", "loop"))
    with pytest.raises(UsageError, match="pace=quick: give one of free, recorded"):
        options.choice("pace", ("free", "recorded"), "free")
    with pytest.raises(UsageError, match="loop=perhaps: give 1 or 0"):
        options.flag("loop", default=False)
