"""`prismstereo flash`: give a sensor its calibration, read it back, and keep the one before."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.baud import baud_option
from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import DataError, DeviceError, UsageError

if TYPE_CHECKING:
    from prismstereo.driver import StereoCamera

_MOST_BYTES = 256 << 10


@click.command("flash", epilog="Example:  prismstereo flash /dev/ttyACM0 --calibration unit.json --backup before.bin")
@click.argument("target", required=False)
@click.option(
    "--calibration", "-c", type=click.Path(path_type=Path), help="What to write: JSON, or flash bytes such as a backup."
)
@click.option("--restore", is_flag=True, help="Go back to the first calibration that the sensor ever had.")
@click.option(
    "--backup",
    type=click.Path(path_type=Path),
    help="Where the one before is saved; default: calibration-DEVICE-HASH.bin in this folder.",
)
@baud_option
@json_option
def command(
    target: str | None, calibration: Path | None, restore: bool, backup: Path | None, baud: int | None, as_json: bool
) -> None:
    """Write a calibration to the sensor at TARGET (default: the one on USB), and read it back.

    What the sensor has is saved first, as a file that `--calibration` takes again. The sensor verifies what it gets and keeps
    the old one where that does not fit; after a cut the write goes on where it was.
    """
    from prismstereo.opening import open_camera
    from prismstereo_device.protocol import calibration_hash

    if restore == (calibration is not None):
        raise UsageError("say either --calibration FILE, to write one, or --restore, to go back to the first one")
    content = None if calibration is None else _flash_bytes(calibration)
    with open_camera(target, baud=baud) as camera:
        before = _held(camera)
        saved = _save(camera, before, backup) if before else None
        if content is None:
            now = camera.restore_calibration()
        else:
            camera.write_calibration(content)
            now = content
        _compare(camera, now)
        device_id = camera.identity.device_id.hex()
    result: dict[str, object] = {
        "device_id": device_id,
        "hash_before": calibration_hash(before).hex() if before else None,
        "hash": calibration_hash(now).hex(),
        "changed": now != before,
        "bytes": len(now),
        "backup": saved,
        "verified": True,
    }
    say(result, _lines(result), as_json=as_json)


def _lines(result: dict[str, object]) -> list[str]:
    lines = [] if result["backup"] is None else [f"the one before ({result['hash_before']}) is in {result['backup']}"]
    what = "is in use now" if result["changed"] else "was in use before"
    lines.append(
        f"calibration {result['hash']} {what} on {result['device_id']}; {result['bytes']} bytes read back and compared"
    )
    return lines


def _flash_bytes(path: Path) -> bytes:
    """Read a calibration file of either form as flash bytes; DataError where it is neither."""
    from prismstereo_calibration import flash, store

    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise UsageError(f"cannot read the calibration {path}: {error.strerror}") from error
    if content.lstrip()[:1] == b"{":
        return flash.pack(store.read(path))
    if len(content) > _MOST_BYTES:
        raise DataError(f"{path} has more than {_MOST_BYTES} bytes: a calibration has fewer")
    flash.unpack(content)
    return content


def _held(camera: StereoCamera) -> bytes:
    """Give what the sensor has; nothing where it has none."""
    return camera.read_calibration() if any(camera.identity.calibration_hash) else b""


def _save(camera: StereoCamera, content: bytes, backup: Path | None) -> Path:
    from prismstereo_device.protocol import calibration_hash
    from prismstereo_hw.files import write_whole

    name = f"calibration-{camera.identity.device_id.hex()}-{calibration_hash(content).hex()}.bin"
    path = Path(name) if backup is None else backup
    if path.exists() and path.read_bytes() != content:
        raise UsageError(f"{path} is there and holds something else: give --backup another name; nothing was written")
    write_whole(path, content)
    return path


def _compare(camera: StereoCamera, content: bytes) -> None:
    found = camera.read_calibration()
    if found != content:
        raise DeviceError(
            f"the sensor holds {len(found)} bytes that are not those that were written: write again, and look at its log"
        )
