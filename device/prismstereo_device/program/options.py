"""The command line of `prismstereo-device`, and the configuration that it comes to."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from prismstereo_device.filters import PRESETS
from prismstereo_device.match import DEFAULT, MATCHERS
from prismstereo_device.program.configuration import Configuration
from prismstereo_device.sensors import SENSORS

__all__ = ["Asked", "read_options"]

_EXAMPLE = """\
examples:
  prismstereo-device --sensor twin:oak-1 --link pty                 a simulated camera on a pseudo-terminal
  prismstereo-device --sensor replay:session --link tcp:127.0.0.1:4000
  prismstereo-device --sensor replay:frames --calibration unit.json --link /dev/ttyGS0
  prismstereo-device --config /etc/prismstereo/device.toml          what the service of a camera runs
  prismstereo-device --config device.toml --matcher bm --check      what that would start, with nothing opened

a configuration (TOML; every field may be left out, --check shows them all):
  sensor = "v4l2:/dev/video0?rig=oak-1"
  link = "/dev/ttyGS0"
  filters = "robot"
  state = "/var/lib/prismstereo"
  [settings]              what a host may change while it runs
  rate_hz = 15.0
  exposure_us = 8000.0

exit codes: 0 ended well, 2 usage, 3 camera or port, 4 data, 75 a host asked for a restart
"""
_OF_CONFIGURATION = (
    "sensor", "link", "symlink", "baud", "calibration", "matcher", "filters", "state", "led", "frames", "rate_hz",
    "lossless", "log_level",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Asked:
    """What the command line asks for: to run a configuration, or (`check`) only to say what would run."""

    configuration: Configuration
    check: bool


def read_options(arguments: list[str] | None = None) -> Asked:
    """Read a command line (default: this process's). Ends the process for `--help` and for what argparse cannot read.

    `UsageError` for a configuration, or an option, that cannot be.
    """
    given = vars(_parser().parse_args(arguments))
    path: Path | None = given["config"]
    read = Configuration() if path is None else Configuration.read(path)
    options = {name: given[name] for name in _OF_CONFIGURATION}
    return Asked(read.with_options(**options), bool(given["check"]))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="prismstereo-device",
        description="The camera's firmware: sensor, split, rectify, match, and compact disparity on a link.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    kinds = "; ".join(f"{name}: {what}" for name, what in SENSORS.items())
    matchers = "; ".join(f"{name}: {what}" for name, what in MATCHERS.items())
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="configuration as TOML; the options below go before its fields")
    add("--check", action="store_true", help="say what would run, as JSON, and end: no sensor and no link is opened")
    add("--sensor", metavar="KIND:...", help=kinds)
    add("--link", metavar="LINK", help="pty (default), tcp:HOST:PORT, or a serial port")
    add("--symlink", metavar="PATH", help="a stable name for the pseudo-terminal")
    add("--baud", type=int, metavar="N", help="speed of a serial port; a pseudo-terminal is made as slow")
    add(
        "--calibration", metavar="FILE", help="JSON or flash bytes, until a host writes one; default: the rig's nominal"
    )
    add("--matcher", help=f"{matchers}; default: {DEFAULT}")
    add("--filters", metavar="NAME|FILE", help=f"filters behind it: {', '.join(PRESETS)}, or a TOML file")
    add("--state", metavar="DIR", help="what outlives a restart; default: $STATE_DIRECTORY, else nothing does")
    add("--led", metavar="DIR", help="a lamp's folder below /sys/class/leds that shows what the camera is about")
    add("--frames", type=_positive, metavar="N", help="stop after so many frames")
    add("--rate", dest="rate_hz", type=float, metavar="HZ", help="at most so many frames a second")
    add("--lossless", action="store_const", const=True, help="wait for the host instead of dropping frames")
    add("--log-level", choices=("debug", "info", "warning", "error"), help="default: warning")
    return parser


def _positive(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of frames: give 1 or more")
    return int(text)
