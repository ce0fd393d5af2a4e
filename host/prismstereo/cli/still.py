"""`prismstereo still`: one full-sensor picture, taken between two video frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.baud import baud_option
from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.still import StillPicture

_ENDINGS = (".png", ".jpg", ".jpeg")
_PNG = b"\x89PNG"


@click.command("still", epilog="Example:  prismstereo still /dev/ttyACM0 -o still.png --crop 1000,500,800,600")
@click.argument("target", required=False)
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Picture to write: .png or .jpg.")
@click.option("--crop", help="Only this rectangle of the full sensor: X,Y,WIDTH,HEIGHT in its pixels.")
@click.option(
    "--timeout",
    "timeout_s",
    default=60.0,
    show_default=True,
    type=click.FloatRange(1, 3600),
    help="Seconds for the camera to take it; fetching it takes what the line needs.",
)
@baud_option
@json_option
def command(target: str | None, out: Path, crop: str | None, timeout_s: float, baud: int | None, as_json: bool) -> None:
    """Take a still with the sensor at TARGET (see `prismstereo devices --help`; default: the one on USB) and write it to OUT.

    The stream goes on meanwhile. OUT is written whole or not at all.
    """
    from prismstereo.opening import open_camera

    if out.suffix.lower() not in _ENDINGS:
        raise UsageError(f"{out} is no picture's name: end it in {', '.join(_ENDINGS)}")
    rectangle = _rectangle(crop)
    with open_camera(target, baud=baud) as camera:
        still = camera.still(rectangle, timeout_s=timeout_s)
        device_id = camera.identity.device_id.hex()
    _write(out, still)
    height, width = still.pixels.shape[:2]
    result: dict[str, object] = {
        "file": out,
        "device_id": device_id,
        "width_px": width,
        "height_px": height,
        "crop_px": still.crop,
        "frame": still.frame,
        "timestamp_us": still.timestamp_us,
        "received_bytes": len(still.data),
    }
    x, y, _, _ = still.crop
    line = f"{out}: {width}x{height} pixels from ({x}, {y}) of the sensor, of frame {still.frame} at {still.timestamp_us} us"
    say(result, [line], as_json=as_json)


def _rectangle(text: str | None) -> tuple[int, int, int, int] | None:
    if text is None:
        return None
    parts = text.split(",")
    if len(parts) != 4 or not all(part.strip().isdecimal() and part.isascii() for part in parts):
        raise UsageError(f"crop {text!r}: give X,Y,WIDTH,HEIGHT in whole pixels, e.g. 1000,500,800,600")
    x, y, width, height = map(int, parts)
    return x, y, width, height


def _write(out: Path, still: StillPicture) -> None:
    """Write the file as it came where the name says the same form, else encode the pixels anew."""
    from prismstereo_hw.files import write_picture, write_whole

    if still.data.startswith(_PNG) == (out.suffix.lower() == ".png"):
        write_whole(out, still.data)
    else:
        write_picture(out, still.pixels)
