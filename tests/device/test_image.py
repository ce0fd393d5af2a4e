"""What is installed on a board: checked by the tools of the system it is for, and by what it has to be consistent with."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from prismstereo_device.program.configuration import Configuration

ROOT = Path(__file__).parents[2]
IMAGE = ROOT / "device" / "image"
UNITS = ("prismstereo.service", "prismstereo-gadget.service")
needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed here")


@pytest.fixture
def units(tmp_path: Path) -> Path:
    """The units as they are installed, but that the programs in them are one that is here."""
    for unit in UNITS:
        text = (IMAGE / unit).read_text()
        (tmp_path / unit).write_text(
            re.sub(r"^(Exec\w+=)/opt/prismstereo/bin/\S+", r"\1/bin/true", text, flags=re.MULTILINE)
        )
    return tmp_path


def systemd_version() -> int:
    said = subprocess.run(["systemd-analyze", "--version"], capture_output=True, text=True, check=True).stdout
    return int(said.split()[1])


def drop_in(units: Path, name: str) -> None:
    (units / "prismstereo.service.d").mkdir()
    shutil.copy(IMAGE / "prismstereo.service.d" / name, units / "prismstereo.service.d")


def verified(unit: Path) -> str:
    done = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return "\n".join(line for line in done.stderr.splitlines() if str(unit.parent) in line or "prismstereo" in line)


@needs_systemd
@pytest.mark.parametrize("unit", UNITS)
def test_systemd_finds_nothing_unknown_in_a_unit(unit: str, units: Path) -> None:
    assert verified(units / unit) == ""


@needs_systemd
def test_systemd_would_have_found_a_key_that_it_does_not_know(units: Path) -> None:
    text = (units / "prismstereo.service").read_text()
    (units / "prismstereo.service").write_text(text.replace("UMask=", "Umask="))
    assert "Unknown key" in verified(units / "prismstereo.service")


@needs_systemd
@pytest.mark.parametrize("name", ["lamp.conf", "backoff.conf"])
def test_systemd_finds_nothing_unknown_in_a_drop_in(name: str, units: Path) -> None:
    if name == "backoff.conf" and systemd_version() < 254:
        pytest.skip("waits that grow came with systemd 254")
    drop_in(units, name)
    assert verified(units / "prismstereo.service") == ""


@needs_systemd
def test_systemd_calls_the_service_well_confined(units: Path) -> None:
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=20", units / "prismstereo.service"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-300:] + done.stderr  # an exposure of at most 2.0 of 10


def test_the_service_is_watched_and_restarted_and_writes_only_its_own_folders() -> None:
    unit = (IMAGE / "prismstereo.service").read_text()
    settings = dict(line.split("=", 1) for line in unit.splitlines() if re.match(r"[A-Z]\w+=", line))
    assert settings["Type"] == "notify"
    assert int(settings["WatchdogSec"]) >= 10  # a matcher on a slow board takes seconds for its first frames
    assert (settings["Restart"], settings["StartLimitIntervalSec"], settings["SuccessExitStatus"]) == (
        "always",
        "0",
        "75",
    )
    assert (settings["ProtectSystem"], settings["DynamicUser"], settings["CapabilityBoundingSet"]) == (
        "strict",
        "yes",
        "",
    )
    assert settings["StateDirectory"] == settings["CacheDirectory"] == "prismstereo"
    assert "NUMBA_CACHE_DIR=%C/prismstereo" in settings["Environment"]
    assert "MemoryDenyWriteExecute" not in settings  # kernels are compiled at run time


KEYS = {
    "SUBSYSTEM",
    "ACTION",
    "KERNEL",
    "DRIVER",
    "ATTR",
    "ATTRS",
    "ENV",
    "GROUP",
    "MODE",
    "SYMLINK",
    "TAG",
}
PART = re.compile(r'([A-Z]+)(?:\{([A-Za-z0-9_]+)\})?(==|!=|\+=|=)"([^"]*)"')


def rules() -> list[list[tuple[str, str, str, str]]]:
    """Every rule as its parts: key, attribute, operator, value."""
    found = []
    for line in (IMAGE / "99-prismstereo.rules").read_text().splitlines():
        if line and not line.startswith("#"):
            parts = [PART.fullmatch(part.strip()) for part in line.split(",")]
            assert all(parts), line
            found.append([part.groups(default="") for part in parts if part is not None])
    return found


def test_every_udev_rule_is_well_formed_and_matches_before_it_sets() -> None:
    assert len(rules()) == 5
    for rule in rules():
        assert {key for key, _, _, _ in rule} <= KEYS
        operators = [operator for _, _, operator, _ in rule]
        compared = [operator in ("==", "!=") for operator in operators]
        setting = [key == "ATTR" and attribute == "latency_timer" for key, attribute, _, _ in rule]
        assert compared == sorted(compared, reverse=True)
        assert any(not one for one in compared)
        assert not any(one and two for one, two in zip(compared, setting, strict=True))


def test_a_cameras_port_is_named_by_its_serial_number_and_left_alone_by_modem_manager() -> None:
    port = next(rule for rule in rules() if ("SYMLINK", "", "+=", "prismstereo-$attr{serial}") in rule)
    assert {("ENV", "ID_MM_DEVICE_IGNORE", "=", "1"), ("SUBSYSTEM", "", "==", "tty")} <= set(port)
    script = (IMAGE / "usb-gadget.sh").read_text()
    for key, attribute in (("idVendor", "ATTRS"), ("idProduct", "ATTRS")):
        value = next(value for k, a, _, value in port if (k, a) == (attribute, key))
        assert f'put "$gadget/{key}" 0x{value}' in script


def test_udev_finds_no_fault_in_the_rules() -> None:
    if shutil.which("udevadm") is None:
        pytest.skip("udev is not installed here")
    known = subprocess.run(["udevadm", "--help"], capture_output=True, text=True, check=False).stdout
    if "verify" not in known:
        pytest.skip("this udevadm has no verify; it came with systemd 254")
    subprocess.run(["udevadm", "verify", IMAGE / "99-prismstereo.rules"], check=True)


def test_the_example_configuration_is_one_and_the_app_has_the_projects_version() -> None:
    example = Configuration.read(IMAGE / "device.example.toml")
    assert (example.link, example.settings.zones) == ("/dev/ttyGS0", True)
    app = tomllib.loads((IMAGE / "oakapp.toml").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert app["app_version"] == project["project"]["version"]
    assert {step["type"] for step in app["prepare_container"]} == {"COPY", "RUN"}
