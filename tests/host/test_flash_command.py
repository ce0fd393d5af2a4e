from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from host.command import in_process
from host.small_device import SmallDevice
from host.test_camera_controls import Desk
from prismstereo.cli.flash import command
from prismstereo_calibration import flash, store
from prismstereo_calibration.model import Calibration
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.objects import Held, ObjectNumber
from prismstereo_device.protocol import calibration_hash
from prismstereo_hw.errors import DataError, DeviceError, UsageError
from prismstereo_hw.rig import Rig


@pytest.fixture
def sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Desk, str]]:
    desk = Desk()
    monkeypatch.chdir(tmp_path)
    with PtyPort() as link, SmallDevice(link, answering=desk):
        yield desk, link.name


@pytest.fixture(scope="module")
def unit(small: Rig) -> Calibration:
    return Calibration.nominal(small)


def test_a_calibration_is_written_read_back_and_the_one_before_saved(sensor, unit: Calibration, tmp_path: Path) -> None:
    desk, port = sensor
    store.write(tmp_path / "unit.json", unit)

    code, text = in_process(command, port, "--calibration", "unit.json", "--json")

    written = desk.committed[ObjectNumber.CALIBRATION]
    told = json.loads(text)
    assert code == 0
    assert flash.unpack(written).rig == unit.rig
    assert told["hash"] == calibration_hash(written).hex()
    assert (told["changed"], told["verified"], told["bytes"]) == (True, True, len(written))
    assert told["hash_before"] == calibration_hash(b"first").hex()
    assert (tmp_path / told["backup"]).read_bytes() == b"first"


def test_flash_bytes_are_taken_as_they_are(sensor, unit: Calibration, tmp_path: Path) -> None:
    desk, port = sensor
    (tmp_path / "unit.bin").write_bytes(flash.pack(unit))

    in_process(command, port, "-c", "unit.bin", "--backup", tmp_path / "before.bin")

    assert desk.committed[ObjectNumber.CALIBRATION] == flash.pack(unit)
    assert (tmp_path / "before.bin").read_bytes() == b"first"


def test_the_first_calibration_comes_back(sensor) -> None:
    desk, port = sensor
    desk.objects[ObjectNumber.CALIBRATION] = Held(4, b"later")

    code, text = in_process(command, port, "--restore", "--backup", "later.bin")

    assert code == 0
    assert desk.objects[ObjectNumber.CALIBRATION].content == b"first"
    assert Path("later.bin").read_bytes() == b"later"
    assert f"calibration {calibration_hash(b'first').hex()} is in use now" in text


def test_a_sensor_that_holds_something_else_afterwards_is_not_called_well(
    sensor, unit: Calibration, monkeypatch
) -> None:
    desk, port = sensor
    store.write("unit.json", unit)
    monkeypatch.setattr(
        "host.test_camera_controls.Desk._written", lambda self, request: super(Desk, self)._written(request)
    )

    with pytest.raises(DeviceError, match="holds 5 bytes that are not those that were written"):
        in_process(command, port, "-c", "unit.json")

    assert ObjectNumber.CALIBRATION in desk.committed


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ([], UsageError, "say either --calibration FILE"),
        (["--restore", "-c", "unit.json"], UsageError, "say either --calibration FILE"),
        (["-c", "absent.json"], UsageError, "cannot read the calibration absent.json"),
        (["-c", "noise.bin"], DataError, "flash"),
        (["-c", "large.bin"], DataError, "has more than 262144 bytes"),
        (["-c", "unit.json", "--backup", "noise.bin"], UsageError, "holds something else"),
    ],
)
def test_nothing_is_written_where_anything_is_wrong(sensor, unit: Calibration, arguments, error, says) -> None:
    desk, port = sensor
    store.write("unit.json", replace(unit))
    Path("noise.bin").write_bytes(b"no calibration")
    Path("large.bin").write_bytes(bytes((256 << 10) + 1))

    with pytest.raises(error, match=says):
        in_process(command, port, *arguments)

    assert desk.committed == {}
    assert Path("noise.bin").read_bytes() == b"no calibration"


def test_a_sensor_that_never_got_one_has_no_first(sensor) -> None:
    del sensor[0].objects[ObjectNumber.FACTORY_CALIBRATION]

    with pytest.raises(DataError, match="no calibration was ever written to"):
        in_process(command, sensor[1], "--restore")
