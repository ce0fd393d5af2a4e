"""Settings: each value has a rule, and a refusal says it."""

from __future__ import annotations

import math

import msgspec
import pytest

from prismstereo_device.control.settings import SettingRules, Settings
from prismstereo_device.match import MATCHERS
from prismstereo_device.protocol.command import CommandReply, CommandStatus, Value
from prismstereo_device.sensors.base import Limit, SensorLimits
from prismstereo_hw.errors import UsageError

LIMITS = SensorLimits(
    exposure_us=Limit(10, 30_000), gain=Limit(1, 16), rate_hz=Limit(1, 60), lens_position=Limit(0, 255)
)
RULES = SettingRules.of(LIMITS, (640, 360))


@pytest.mark.parametrize(
    ("name", "value", "accepted"),
    [
        ("exposure_us", 8000, 8000.0),
        ("exposure_us", 30_000.0, 30_000.0),
        ("exposure_us", "auto", "auto"),
        ("gain", 1, 1.0),
        ("rate_hz", 12.5, 12.5),
        ("lens_position", 140, 140),
        ("region", [0, 0, 640, 360], [0, 0, 640, 360]),
        ("region", "auto", "auto"),
        ("matcher", "bm", "bm"),
        ("bound", 4, 4),
        ("bound", "auto", "auto"),
        ("stream", False, False),
        ("zones", True, True),
    ],
)
def test_a_value_inside_its_rule_is_accepted_and_given_back(name: str, value: Value, accepted: Value) -> None:
    changed = Settings().with_value(name, value, RULES)
    assert changed.value(name) == accepted
    assert type(changed.value(name)) is type(accepted)


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("exposure_us", 9, "give a number from 10 to 30000 us or auto"),
        ("exposure_us", math.nan, "from 10 to 30000 us"),
        ("exposure_us", True, "a number from"),
        ("exposure_us", "bright", "a number from"),
        ("gain", 17.0, "from 1 to 16"),
        ("rate_hz", math.inf, "from 1 to 60 Hz"),
        ("rate_hz", "auto", "from 1 to 60 Hz"),
        ("lens_position", 140.5, "a whole number from 0 to 255"),
        ("lens_position", 256, "a whole number from 0 to 255"),
        ("region", [0, 0, 641, 360], "inside 640x360 pixels"),
        ("region", [-1, 0, 10, 10], "inside 640x360 pixels"),
        ("region", [0, 0, 0, 10], "inside 640x360 pixels"),
        ("region", [0, 0, 10], "[x, y, width, height]"),
        ("matcher", "magic", "one of tiles, semiglobal, sgbm"),
        ("matcher", "onnx:/etc/passwd", "one of tiles"),
        ("bound", 3, "one of 0, 1, 2, 4 or auto"),
        ("bound", False, "one of 0, 1, 2, 4 or auto"),
        ("stream", 1, "true or false"),
        ("raw", None, "true or false"),
    ],
)
def test_a_value_outside_its_rule_is_refused_in_a_sentence_that_fits_a_packet(
    name: str, value: Value, rule: str
) -> None:
    with pytest.raises(UsageError) as caught:
        Settings().with_value(name, value, RULES)
    assert str(caught.value).startswith(f"{name} ")
    assert rule in str(caught.value)
    assert CommandReply.unpack(CommandReply(CommandStatus.REFUSED, why=str(caught.value)).pack()).why == str(
        caught.value
    )


def test_what_a_sensor_cannot_do_is_refused_by_name() -> None:
    blind = SettingRules.of(SensorLimits(), (640, 360))
    for name, value in (("exposure_us", 8000.0), ("gain", 2.0), ("rate_hz", 30.0), ("lens_position", 3)):
        with pytest.raises(UsageError, match=f"{name}: this sensor cannot set it; leave it as it is"):
            Settings().with_value(name, value, blind)


def test_the_lens_leaves_its_calibrated_position_only_while_nothing_is_matched() -> None:
    rules = SettingRules.of(LIMITS, (640, 360), calibrated_lens=140)
    for settings in (Settings(), Settings(stream=False, zones=True)):
        with pytest.raises(
            UsageError, match="lens_position 150: the calibration is for 140; set stream and zones to false"
        ):
            settings.with_value("lens_position", 150, rules)
    idle = Settings(stream=False, raw=True).with_value("lens_position", 150, rules)
    assert idle.lens_position == 150
    with pytest.raises(UsageError, match="the calibration is for 140"):
        idle.with_value("stream", value=True, rules=rules)
    assert idle.with_value("lens_position", 140, rules).with_value("stream", value=True, rules=rules).stream


def test_settings_of_a_file_are_held_to_the_same_rules() -> None:
    settings = Settings(exposure_us=8000.0, region=(0, 0, 320, 180), bound=2, matcher="bm")
    assert settings.checked(SettingRules.of(LIMITS, (640, 360), matcher="bm")) == settings
    with pytest.raises(UsageError, match="inside 100x100 pixels"):
        settings.checked(SettingRules.of(LIMITS, (100, 100), matcher="bm"))
    with pytest.raises(UsageError, match="exposure_us: this sensor cannot set it"):
        settings.checked(SettingRules.of(SensorLimits(), (640, 360), matcher="bm"))


def test_a_matcher_that_only_the_start_may_choose_can_be_gone_back_to() -> None:
    rules = SettingRules.of(LIMITS, (640, 360), matcher="onnx:model.onnx")
    assert Settings().with_value("matcher", "onnx:model.onnx", rules).matcher == "onnx:model.onnx"


def test_the_rules_tell_a_host_enough_to_build_a_page_from() -> None:
    told = {
        rule["name"]: rule for rule in msgspec.json.decode(msgspec.json.encode([r.described() for r in RULES.values()]))
    }
    assert set(told) == set(Settings.__struct_fields__)
    assert told["exposure_us"] == {
        "name": "exposure_us", "kind": "number", "automatic": True, "unit": "us", "least": 10, "most": 30_000
    }  # fmt: skip
    assert told["matcher"]["choices"] == list(MATCHERS)
    assert (told["region"]["width"], told["region"]["height"], told["region"]["unit"]) == (640, 360, "px")
    assert told["zones"]["about"]
