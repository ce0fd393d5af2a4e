"""`prismstereo doctor`: checks that everything this product needs is here and works."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from importlib import metadata

import click

from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import PrismStereoError

_REQUIRED = ("numpy", "opencv-python-headless", "numba", "scipy", "pyserial", "google-crc32c", "zstandard", "msgspec")
_FOR_SOME = {"depthai": "OAK cameras", "onnxruntime": "learned matchers"}
_CRC_OF_DIGITS = 0xE3069283  # CRC-32C of "123456789", the published check value


@click.command("doctor", epilog="Example:  prismstereo doctor --json")
@json_option
def command(as_json: bool) -> int:
    """Check Python, the libraries, the kernels, the codec and the line; exit code 1 when something needed is amiss."""
    checks = [*(_library(name) for name in _REQUIRED), *(_optional(name, use) for name, use in _FOR_SOME.items())]
    checks += [_attempt(name, work) for name, work in _TRIALS.items()]
    failed = [check for check in checks if not check["ok"] and check["needed"]]
    say(
        {"ok": not failed, "python": sys.version.split()[0], "checks": checks},
        [
            f"Python {sys.version.split()[0]}",
            *(f"{_mark(check)} {check['name']}: {check['detail']}" for check in checks),
            "something that is needed is amiss" if failed else "everything that is needed is here",
        ],
        as_json=as_json,
    )
    return 1 if failed else 0


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
