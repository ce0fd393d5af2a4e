from __future__ import annotations

from collections.abc import Iterator

import msgspec
import pytest

from host.small_device import Answering, SmallDevice
from prismstereo.driver import StereoCamera
from prismstereo_device.control.settings import SettingRules, Settings
from prismstereo_device.link.loopback import loopback
from prismstereo_device.objects import Held, ObjectNumber
from prismstereo_device.protocol import Command, CommandReply, CommandStatus
from prismstereo_device.sensors.base import Limit, SensorLimits, StampQuality
from prismstereo_device.wire import WireError
from prismstereo_hw.errors import UsageError

RULES = SettingRules.of(SensorLimits(exposure_us=Limit(10, 30_000), rate_hz=Limit(1, 60)), (640, 360))


class Settable(Answering):
    """A device that keeps settings, and describes them as the firmware does."""

    def __init__(self) -> None:
        told = {"stamp_quality": "exposure", "settings": [rule.described() for rule in RULES.values()]}
        super().__init__({ObjectNumber.IDENTITY: Held(1, msgspec.json.encode(told))})
        self.settings = Settings()

    def command(self, command: Command) -> CommandReply:
        self.ran.append((command.verb, command.name, command.value))
        if command.verb == "set":
            self.settings = self.settings.with_value(command.name, command.value, RULES)
        return CommandReply(CommandStatus.OK, self.settings.value(command.name))


@pytest.fixture
def desk() -> Iterator[tuple[Settable, StereoCamera]]:
    device_end, host_end = loopback()
    answering = Settable()
    with device_end, SmallDevice(device_end, answering=answering), StereoCamera(host_end) as camera:
        yield answering, camera


def test_every_setting_comes_with_its_value_its_unit_its_range_and_a_word_of_help(desk) -> None:
    found = dict(desk[1].settings)
    assert list(found) == list(RULES)
    exposure = found["exposure_us"]
    assert (exposure.value, exposure.unit, exposure.least, exposure.most) == ("auto", "us", 10, 30_000)
    assert exposure.automatic
    assert found["bound"].choices == (0, 1, 2, 4)
    assert (found["region"].size, found["region"].least) == ((640, 360), None)
    assert found["gain"].unavailable
    assert found["gain"].most is None
    assert all(setting.help for setting in found.values())


@pytest.mark.parametrize(
    ("name", "value", "in_force"),
    [
        ("exposure_us", 8000, 8000.0),
        ("region", (0, 0, 64, 36), [0, 0, 64, 36]),
        ("zones", True, True),
        ("bound", "auto", "auto"),
    ],
)
def test_assigning_sets_and_the_camera_says_what_is_in_force(desk, name, value, in_force) -> None:
    settings = desk[1].settings
    settings[name] = value
    assert settings[name].value == in_force
    assert settings.change(name, value) == in_force


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("exposure_us", 40_000, "exposure_us 40000: give a number from 10 to 30000 us or auto"),
        ("zones", 1, "give true or false"),
        ("matcher", "magic", "give one of tiles"),
        ("region", (0, 0, 641, 1), "inside 640x360"),
        ("gain", 2.0, "this sensor cannot set it"),
        ("colour", 1, "there is no setting 'colour': there are exposure_us"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(desk, name, value, says) -> None:
    answering, camera = desk
    with pytest.raises(UsageError, match=says):
        camera.settings[name] = value
    assert answering.ran == []


def test_a_name_that_there_is_not_is_a_key_error(desk) -> None:
    assert "colour" not in desk[1].settings
    assert "bound" in desk[1].settings
    with pytest.raises(KeyError):
        _ = desk[1].settings["colour"]


def test_a_kind_that_a_later_camera_has_is_left_to_the_camera(desk) -> None:
    answering, camera = desk
    told = {"settings": [{"name": "gain", "kind": "curve", "new": 1}]}
    answering.objects[ObjectNumber.IDENTITY] = Held(2, msgspec.json.encode(told))
    answering.command = lambda command: CommandReply(CommandStatus.OK, command.value)
    assert camera.settings.change("gain", [1, 2, 3]) == [1, 2, 3]


def test_settings_that_cannot_be_read_are_an_error_by_name(desk) -> None:
    desk[0].objects[ObjectNumber.IDENTITY] = Held(2, b'{"settings": [{"name": 7}]}')
    with pytest.raises(WireError, match="the camera's settings cannot be read"):
        len(desk[1].settings)


def test_the_meaning_of_stamps_is_asked_once(desk) -> None:
    answering, camera = desk
    assert camera.stamp_quality is StampQuality.EXPOSURE
    answering.objects[ObjectNumber.IDENTITY] = Held(2, b'{"stamp_quality": "made"}')
    assert camera.stamp_quality is StampQuality.EXPOSURE
