"""`prismstereo doctor`: checks that everything this product needs is here and works, and gathers what a bug report needs."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import DeviceError, PrismStereoError, UsageError

if TYPE_CHECKING:
    from prismstereo.doctor_bundle import BundlePart
    from prismstereo.driver import StereoCamera

_REQUIRED = ("numpy", "opencv-python-headless", "numba", "scipy", "pyserial", "google-crc32c", "zstandard", "msgspec")
_FOR_SOME = {"depthai": "OAK cameras", "onnxruntime": "learned matchers"}
_FIRST_FRAME_S = 10.0
_CRC_OF_DIGITS = 0xE3069283  # CRC-32C of "123456789", the published check value


@click.command("doctor", epilog="Example:  prismstereo doctor --bundle report.zip --port /dev/ttyACM0")
@click.option("--port", help="Look at this sensor, too (see `prismstereo devices --help`).")
@click.option(
    "--bundle",
    type=click.Path(path_type=Path),
    help="Gather versions, findings, and of the sensor its log, calibration and a recording into this ZIP file. Sent nowhere.",
)
@click.option(
    "--seconds", default=5.0, show_default=True, type=click.FloatRange(0.5, 60), help="Recording in the bundle."
)
@click.option("--yes", is_flag=True, help="Write the bundle without asking.")
@json_option
def command(port: str | None, bundle: Path | None, seconds: float, yes: bool, as_json: bool) -> int:
    """Check Python, the libraries, the kernels, the codec and the line; exit code 1 when something needed is amiss.

    What goes into a bundle is listed before it is written, and asked for unless --yes is given.
    """
    if bundle is not None and bundle.exists():
        raise UsageError(f"{bundle} is there already: give --bundle another name")
    checks = [*(_library(name) for name in _REQUIRED), *(_optional(name, use) for name, use in _FOR_SOME.items())]
    checks += [_attempt(name, work) for name, work in _TRIALS.items()]
    parts: list[BundlePart] = []
    if port is not None:
        checks.append(_attempt("sensor", lambda: _sensor(port, seconds if bundle else None, parts)))
    failed = [check for check in checks if not check["ok"] and check["needed"]]
    written = None if bundle is None else _bundle(bundle, checks, parts, yes=yes)
    say(
        {"ok": not failed, "python": sys.version.split()[0], "checks": checks, "bundle": written},
        [
            f"Python {sys.version.split()[0]}",
            *(f"{_mark(check)} {check['name']}: {check['detail']}" for check in checks),
            "something that is needed is amiss" if failed else "everything that is needed is here",
            *([] if bundle is None else [f"{bundle} is written" if written else f"{bundle} is not written"]),
        ],
        as_json=as_json,
    )
    return 1 if failed else 0


def _sensor(port: str, seconds: float | None, parts: list[BundlePart]) -> str:
    """Meet a sensor and look at its stream; for a bundle, ask it everything."""
    from prismstereo.doctor_bundle import sensor_parts
    from prismstereo.opening import open_camera
    from prismstereo.veil import Veil

    with open_camera(port, reconnect=False) as camera:
        first = camera.take(_FIRST_FRAME_S)
        if first is None:
            raise DeviceError(
                f"{port} answers, but no frame came within {_FIRST_FRAME_S:g} s: is its stream switched on?"
            )
        if seconds is not None:
            click.echo(f"asking {port}, and recording it for {seconds:g} s", err=True)
            parts += sensor_parts(camera, seconds, Veil.of_this_machine())
        return _how_it_went(port, camera)


def _how_it_went(port: str, camera: StereoCamera) -> str:
    statistics = camera.statistics
    return (
        f"{port} is {camera.identity.device_id.hex()}: {statistics.frames} frames, {statistics.partial} partial, "
        f"{statistics.lost} lost, {statistics.line.bad} of {statistics.line.good + statistics.line.bad} packets bad"
    )


def _bundle(
    path: Path, checks: list[dict[str, object]], parts: list[BundlePart], *, yes: bool
) -> dict[str, object] | None:
    """Show what would be written, ask, and write it; None where it is not wanted."""
    from prismstereo.doctor_bundle import installation_parts, packed
    from prismstereo.veil import Veil
    from prismstereo_hw.files import write_whole

    whole = [*installation_parts(checks, Veil.of_this_machine()), *parts]
    click.echo(f"{path} gets:", err=True)
    for part in whole:
        click.echo(f"  {part.name:26} {len(part.content):>10} bytes  {part.about}", err=True)
    if not yes and not click.confirm("Write it? It is sent nowhere.", default=True, err=True):
        return None
    content = packed(whole)
    write_whole(path, content)
    return {"file": path, "bytes": len(content), "parts": {part.name: len(part.content) for part in whole}}


def _mark(check: dict[str, object]) -> str:
    return "ok  " if check["ok"] else ("FAIL" if check["needed"] else "-   ")


def _library(name: str) -> dict[str, object]:
    try:
        return {"name": name, "ok": True, "needed": True, "detail": metadata.version(name)}
    except metadata.PackageNotFoundError:
        return {"name": name, "ok": False, "needed": True, "detail": "not installed: run `make setup` again"}


def _optional(name: str, use: str) -> dict[str, object]:
    check = _library(name)
    if not check["ok"]:
        check = {**check, "needed": False, "detail": f"not installed; only {use} need it"}
    return check


def _attempt(name: str, work: Callable[[], str]) -> dict[str, object]:
    try:
        return {"name": name, "ok": True, "needed": True, "detail": work()}
    except (
        ArithmeticError,
        AssertionError,
        ImportError,
        LookupError,
        OSError,
        RuntimeError,
        ValueError,
        PrismStereoError,
    ) as error:
        return {"name": name, "ok": False, "needed": True, "detail": f"{type(error).__name__}: {error}"}


def _kernels() -> str:
    from prismstereo_device.framing import Deframer, Framer
    from prismstereo_device.wire import Channel

    packet = Framer(7).encode(Channel.CTRL, b"\0" * 300)
    found = Deframer(7).feed(packet)
    assert found[0].payload == b"\0" * 300, "a packet did not survive framing"
    return "compiled, a packet comes through"


def _checksum() -> str:
    import google_crc32c

    assert google_crc32c.value(b"123456789") == _CRC_OF_DIGITS, "wrong check value"
    return f"CRC-32C by {google_crc32c.implementation}"


def _line() -> str:
    try:
        device, host = os.openpty()
    except (AttributeError, OSError):
        return "no pseudo-terminals here: the demo uses TCP on loopback"
    os.close(device)
    os.close(host)
    return "pseudo-terminals are there"


def _optics() -> str:
    from prismstereo_calibration.model import Calibration
    from prismstereo_hw.rig import BUILT_IN, Rig

    baselines = (f"{name} {Calibration.nominal(Rig.read(name)).baseline:.1f} mm" for name in BUILT_IN)
    return "baselines " + ", ".join(baselines)


_TRIALS: dict[str, Callable[[], str]] = {
    "framing kernels": _kernels,
    "checksum": _checksum,
    "line": _line,
    "optics": _optics,
}
