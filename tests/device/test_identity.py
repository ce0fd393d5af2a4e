"""Who the camera is: the same over restarts, and no secret told."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from device.small_camera import DrawnSensor, plain_calibration, plain_rig
from prismstereo_device.control.identity import Names, board_temperature_c, device_id, identity_json, without_password
from prismstereo_device.control.settings import SettingRules, Settings
from prismstereo_device.matching import Matching
from prismstereo_device.serving.device_identity import DeviceIdentity
from prismstereo_device.state import MemoryDisk, RealDisk

MACHINE = "0123456789abcdef0123456789abcdef"


@pytest.fixture
def machine(tmp_path: Path) -> tuple[Path, ...]:
    (tmp_path / "machine-id").write_text(MACHINE + "\n")
    return tmp_path / "missing", tmp_path / "machine-id"


def test_a_unit_keeps_its_number_whatever_becomes_of_its_machine(tmp_path: Path, machine: tuple[Path, ...]) -> None:
    first = device_id(RealDisk(tmp_path / "state"), machine)
    assert len(first) == 8
    assert MACHINE[:16] not in first.hex()
    assert device_id(RealDisk(tmp_path / "state"), ()) == first
    assert device_id(RealDisk(tmp_path / "other"), machine) == first  # a card that was erased


def test_a_unit_without_a_machine_id_draws_a_number(tmp_path: Path) -> None:
    (tmp_path / "machine-id").write_text("0" * 32)
    numbers = {device_id(MemoryDisk(), (tmp_path / "machine-id",)) for _ in range(3)}
    assert len(numbers) == 3


def test_a_number_that_cannot_be_kept_is_still_one(machine: tuple[Path, ...]) -> None:
    class ReadOnly(MemoryDisk):
        def write(self, name: str, data: bytes) -> None:
            raise OSError(30, "Read-only file system")

    assert device_id(ReadOnly(), machine) == device_id(MemoryDisk(), machine)


def test_the_identity_tells_what_a_page_needs_and_no_password() -> None:
    matching = Matching(plain_calibration(), Settings(matcher="bm"))
    sensor = DrawnSensor()
    sensor.rig = plain_rig()
    rules = SettingRules.of(sensor.limits, matching.picture)
    who = DeviceIdentity(bytes(range(8)), 77)
    address = "url:rtsp://eve:secret@camera/1"
    told = msgspec.json.decode(
        identity_json(Names(name="left arm"), who, address=address, sensor=sensor, matching=matching, rules=rules)
    )
    assert (told["serial"], told["boot_id"], told["name"]) == ("0001020304050607", 77, "left arm")
    assert (told["rig"], told["stamp_quality"]) == ("wedge", "made")
    assert told["modes"][1] == {"width": 640, "height": 480, "pixel_format": "GREY", "rate_hz": 0.0}
    assert told["limits"]["gain"] == {"least": 1.0, "most": 16.0}
    assert {setting["name"] for setting in told["settings"]} == set(Settings.__struct_fields__)
    assert told["calibration"]["picture_width"] == matching.picture[0]
    assert told["sensor"] == "url:rtsp://camera/1"
    assert without_password("v4l2:/dev/video0") == "v4l2:/dev/video0"


def test_the_board_is_as_warm_as_its_warmest_place(tmp_path: Path) -> None:
    assert board_temperature_c(tmp_path) is None
    for zone, said in (("thermal_zone0", "41500\n"), ("thermal_zone1", "47250\n"), ("thermal_zone2", "?")):
        (tmp_path / zone).mkdir()
        (tmp_path / zone / "temp").write_text(said)
    assert board_temperature_c(tmp_path) == 47.25
