"""Who the camera is: a number for life, a number for this start, and what a host needs to know to build a page from it."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import logging
import re
import secrets
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec

from prismstereo_device.control.command_table import ACTIONS
from prismstereo_device.control.settings import SettingRules
from prismstereo_device.match import MATCHERS
from prismstereo_device.matching import Matching
from prismstereo_device.sensors.base import Sensor
from prismstereo_device.serving.device_identity import DeviceIdentity
from prismstereo_device.state import Disk

__all__ = ["Names", "board_temperature_c", "device_id", "identity_json", "program_version", "without_password"]

logger = logging.getLogger(__name__)

_FILE = "device-id"
_ID_BYTES = 8
_MACHINE_IDS = (Path("/etc/machine-id"), Path("/var/lib/dbus/machine-id"))
_THERMAL = Path("/sys/class/thermal")
_SALT = b"prismstereo device\n"  # a machine's own id is not to be handed around
_USER = re.compile(r"(//)[^/@\s]*@")


@dataclass(frozen=True, slots=True)
class Names:
    """What the maker and the owner call this unit; an empty serial is the number for life."""

    product: str = "prismstereo"
    serial: str = ""
    name: str = ""


def device_id(disk: Disk, machine_ids: tuple[Path, ...] = _MACHINE_IDS) -> bytes:
    """Give this unit's 8 bytes: those that the disk holds, else made once of the machine's id, or drawn, and kept there."""
    with contextlib.suppress(OSError, ValueError):
        kept = bytes.fromhex(disk.read(_FILE).decode("ascii"))
        if len(kept) == _ID_BYTES:
            return kept
    made = _of_machine(machine_ids) or secrets.token_bytes(_ID_BYTES)
    try:
        disk.write(f"{_FILE}.new", made.hex().encode())
        disk.sync(f"{_FILE}.new")
        disk.rename(f"{_FILE}.new", _FILE)
        disk.sync_folder()
    except OSError as error:
        logger.warning("the device's id could not be kept (%s): the next start may make another", error)
    return made


def program_version() -> str:
    """Give the version of the installed program; `0` where it runs without being installed."""
    try:
        return importlib.metadata.version("prismstereo")
    except importlib.metadata.PackageNotFoundError:
        return "0"


def board_temperature_c(folder: Path = _THERMAL) -> float | None:
    """Tell how warm the warmest place of the board is that the kernel measures; None where it measures none."""
    found = []
    for zone in folder.glob("thermal_zone*/temp"):
        with contextlib.suppress(OSError, ValueError):
            found.append(int(zone.read_text("ascii")) / 1000)
    return max(found, default=None)


def without_password(address: str) -> str:
    """Give a sensor's address without the name and the password that a network camera's may hold."""
    return _USER.sub(r"\1", address)


def identity_json(
    names: Names, who: DeviceIdentity, *, address: str, sensor: Sensor, matching: Matching, rules: SettingRules
) -> bytes:
    """Give the identity object: who, since when, the sensor and its modes, and all that can be set, with range and unit."""
    calibration = matching.calibration
    told = {
        **asdict(names),
        "serial": names.serial or who.device_id.hex(),
        "version": program_version(),
        "device_id": who.device_id.hex(),
        "boot_id": who.boot_id,
        "sensor": without_password(address),
        "rig": None if sensor.rig is None else sensor.rig.name,
        "modes": sensor.modes,
        "limits": sensor.limits,
        "stamp_quality": sensor.stamp_quality.value,
        "matchers": MATCHERS,
        "settings": [rule.described() for rule in rules.values()],
        "actions": ACTIONS,
        "calibration": {
            "hash": matching.calibration_hash.hex(),
            "rig": calibration.rig,
            "frame_width": calibration.frame_width,
            "frame_height": calibration.frame_height,
            "lens_position": calibration.lens_position,
            "picture_width": matching.picture[0],
            "picture_height": matching.picture[1],
            "labels": matching.labels,
        },
    }
    return msgspec.json.encode(told)


def _of_machine(files: tuple[Path, ...]) -> bytes | None:
    for file in files:
        with contextlib.suppress(OSError):
            said = file.read_bytes().strip()
            if re.fullmatch(rb"[0-9a-f]{32}", said) and said.strip(b"0"):
                return hashlib.sha256(_SALT + said).digest()[:_ID_BYTES]
    return None
