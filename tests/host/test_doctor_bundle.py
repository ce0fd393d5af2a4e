from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from host.calibrated_source import Wall
from prismstereo.cli.doctor import command
from prismstereo.doctor_bundle import sensor_parts
from prismstereo.driver import StereoCamera
from prismstereo.veil import Veil
from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device.link import Link
from prismstereo_device.link.loopback import loopback
from prismstereo_device.link.pty_port import PtyPort
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.serving.fixed_objects import FixedObjects
from prismstereo_device.serving.service import DeviceIdentity, Service
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig

HOME = "/srv/people/joanna"
LOG = b"INFO camera: read /srv/people/joanna/rig.toml, token=abc\n"


@pytest.fixture(scope="module")
def wall(small: Rig) -> Wall:
    return Wall(Calibration.nominal(small), 900.0)


def served(wall: Wall, link: Link) -> Service:
    told = {"version": "1", "sensor": "twin:" + HOME + "/rig.toml", "settings": []}
    objects = {
        ObjectNumber.CALIBRATION: wall.content,
        ObjectNumber.IDENTITY: msgspec.json.encode(told),
        ObjectNumber.LOG: LOG,
    }
    return Service(wall.again(), link, DeviceIdentity(b"serial-1", 7), objects=FixedObjects(objects))


@pytest.fixture
def camera(wall: Wall) -> Iterator[StereoCamera]:
    device, host = loopback()
    with device, served(wall, device), StereoCamera(host) as opened:
        yield opened


def test_a_sensor_is_asked_everything_and_what_it_does_not_give_is_named(camera: StereoCamera, wall: Wall) -> None:
    parts = {part.name: part.content for part in sensor_parts(camera, 0.3, Veil(()))}

    missing = json.loads(parts["sensor/missing.json"])
    assert set(missing) == {"self_test.json", "optics.json"}
    assert "takes no commands" in missing["self_test.json"]
    assert parts["sensor/calibration.bin"] == wall.content
    assert flash.unpack(wall.content).rig in parts["sensor/calibration.json"].decode()
    assert json.loads(parts["sensor/statistics.json"])["statistics"]["frames"] > 0
    reader = make_reader(io.BytesIO(parts["sensor/recording.mcap"]))
    assert sum(1 for _ in reader.iter_messages()) > 3


def test_no_home_folder_and_no_secret_gets_in_not_even_by_the_recording(camera: StereoCamera) -> None:
    parts = {part.name: part.content for part in sensor_parts(camera, 0.3, Veil((HOME,)))}

    assert parts["sensor/log.txt"] == b"INFO camera: read ~/rig.toml, token=***\n"
    assert json.loads(parts["sensor/identity.json"])["sensor"] == "twin:~/rig.toml"
    assert "the name of a home folder" in json.loads(parts["sensor/missing.json"])["recording.mcap"]
    assert not any(HOME.encode() in content for content in parts.values())


@pytest.fixture
def port(wall: Wall) -> Iterator[str]:
    with PtyPort() as link, served(wall, link):
        yield link.name


def test_a_bundle_is_listed_and_asked_for_before_it_is_written(port: str, tmp_path: Path) -> None:
    out = tmp_path / "report.zip"
    arguments = ["--port", port, "--bundle", str(out), "--seconds", "0.5"]

    refused = CliRunner().invoke(command, arguments, input="n\n", standalone_mode=False)

    assert refused.exception is None
    assert "sensor/log.txt" in refused.stderr
    assert not out.exists()
    assert f"{out} is not written" in refused.stdout

    done = CliRunner().invoke(command, [*arguments, "--yes", "--json"], standalone_mode=False)

    assert done.exception is None
    told = json.loads(done.stdout)
    with zipfile.ZipFile(out) as bundle:
        assert set(bundle.namelist()) == {"README.txt", *told["bundle"]["parts"]}
        assert "sensor/recording.mcap" in bundle.read("README.txt").decode()
        versions = json.loads(bundle.read("versions.json"))
    assert versions["packages"]["numpy"] != "not installed"
    sensor = next(check for check in told["checks"] if check["name"] == "sensor")
    assert sensor["ok"]
    assert b"serial-1".hex() in sensor["detail"]


def test_a_bundle_without_a_sensor_says_what_is_installed_and_nothing_is_overwritten(tmp_path: Path) -> None:
    out = tmp_path / "report.zip"
    done = CliRunner().invoke(command, ["--bundle", str(out), "--yes"], standalone_mode=False)
    assert done.exception is None
    with zipfile.ZipFile(out) as bundle:
        assert bundle.namelist() == ["README.txt", "versions.json", "checks.json"]
    before = out.read_bytes()
    again = CliRunner().invoke(command, ["--bundle", str(out), "--yes"], standalone_mode=False)
    assert isinstance(again.exception, UsageError)
    assert out.read_bytes() == before


def test_a_sensor_that_is_not_there_is_a_finding_and_no_end(tmp_path: Path) -> None:
    done = CliRunner().invoke(command, ["--port", "/dev/ttyNOWHERE", "--json"], standalone_mode=False)
    assert done.return_value == 1
    sensor = json.loads(done.stdout)["checks"][-1]
    assert (sensor["name"], sensor["ok"]) == ("sensor", False)
    assert "PortError" in sensor["detail"]
