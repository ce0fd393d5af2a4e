"""The camera's own calibration memory, kept in a file before anything else is done with the camera.

Nothing in this package writes to that memory. But the library can, and people lost factory calibrations to it.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from prismstereo_hw.errors import DeviceError

__all__ = ["back_up"]

_UNSAFE = re.compile(r"[^A-Za-z0-9._-]")
_NAMED = 12  # hexadecimal digits of the content's sha256 in a file's name


def back_up(device: Any, folder: Path) -> Path:
    """Write user and factory calibration of an opened `dai.Device`, values and bytes, to `folder` as JSON; return the file.

    The name tells device and content, so a backup is never written over: another content is another file, and the same
    content is there already. Whole or not at all. `DeviceError` where it cannot be written: then nothing else may go on.
    """
    device_id = str(device.getDeviceId())
    kept = {
        "device_id": device_id,
        "user": _told(lambda: device.readCalibration().eepromToJson()),
        "factory": _told(lambda: device.readFactoryCalibration().eepromToJson()),
        "user_bytes": _told(lambda: bytes(device.readCalibrationRaw()).hex()),
        "factory_bytes": _told(lambda: bytes(device.readFactoryCalibrationRaw()).hex()),
    }
    content = json.dumps(kept, indent=1, sort_keys=True).encode() + b"\n"
    name = f"oak-{_UNSAFE.sub('_', device_id)}-{hashlib.sha256(content).hexdigest()[:_NAMED]}.json"
    path = folder / name
    if not path.is_file():
        try:
            _write_new(path, content)
        except OSError as error:
            raise DeviceError(
                f"the camera's calibration memory cannot be backed up to {path}: {error.strerror}: give a folder that can be "
                "written to; without a backup the camera is not used for stereo"
            ) from error
    return path


def _told(read: Callable[[], Any]) -> Any:
    """Return what a memory holds; None for one that is empty or not there, which depthai tells by raising."""
    try:
        return read()
    except RuntimeError:
        return None


def _write_new(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.parent / f".{path.name}.{secrets.token_hex(6)}"
    try:
        with unfinished.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        with suppress(FileExistsError):  # another process was quicker, with the same content: the name says so
            os.link(unfinished, path)  # unlike a rename, never replaces
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    finally:
        with suppress(OSError):
            unfinished.unlink()
