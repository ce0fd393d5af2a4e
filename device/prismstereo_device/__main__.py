"""The firmware's program: `prismstereo-device --sensor twin:oak-1 --link pty`.

Standard output carries two lines of JSON: where it listens, and, at the end, the counters. Logs go to standard error.
"""

from __future__ import annotations

import argparse
import json
import logging
import secrets
import signal
import sys
import time
import uuid
from dataclasses import asdict
from pathlib import Path

from prismstereo_calibration import flash, schema
from prismstereo_calibration.model import Calibration
from prismstereo_device.camera import CameraSource
from prismstereo_device.filters import PRESETS, FilterChain, chain
from prismstereo_device.filters import warm_up as warm_up_filters
from prismstereo_device.link import Link
from prismstereo_device.match import DEFAULT, MATCHERS, create, warm_up
from prismstereo_device.pipeline import Pipeline
from prismstereo_device.sensors import SENSORS, Sensor, open_sensor
from prismstereo_device.service import DeviceIdentity, Service
from prismstereo_hw.errors import PrismStereoError, UsageError

__all__ = ["main"]

_MOST_CALIBRATION_BYTES = 256 * 1024
_SOON_S = 1.0  # reading compiled kernels back from disk takes less
_EXAMPLE = """\
examples:
  prismstereo-device --sensor twin:oak-1 --link pty                 a simulated camera on a pseudo-terminal
  prismstereo-device --sensor replay:session --link tcp:127.0.0.1:4000
  prismstereo-device --sensor replay:frames --calibration unit.json --link /dev/ttyGS0
"""


def main(arguments: list[str] | None = None) -> None:
    """Run the firmware until its link or its sensor ends, or it is told to stop."""
    options = _options(arguments)
    logging.basicConfig(
        level=options.log_level.upper(), stream=sys.stderr, format="%(levelname)s %(name)s: %(message)s"
    )
    try:
        _serve(options)
    except PrismStereoError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="prismstereo-device",
        description="The camera's firmware: sensor, split, rectify, match, and compact disparity on a link.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    kinds = "; ".join(f"{name}: {what}" for name, what in SENSORS.items())
    parser.add_argument("--sensor", required=True, metavar="KIND:...", help=kinds)
    parser.add_argument("--link", default="pty", metavar="LINK", help="pty, tcp:HOST:PORT, or a serial port")
    parser.add_argument("--symlink", type=Path, metavar="PATH", help="a stable name for the pseudo-terminal")
    parser.add_argument("--baud", type=int, metavar="N", help="speed of a serial port")
    parser.add_argument(
        "--calibration", type=Path, metavar="FILE", help="JSON or flash bytes; default: the rig's nominal"
    )
    matchers = "; ".join(f"{name}: {what}" for name, what in MATCHERS.items())
    parser.add_argument("--matcher", default=DEFAULT, help=matchers)
    parser.add_argument(
        "--filters", metavar="NAME|FILE", help=f"filters behind it: {', '.join(PRESETS)}, or a TOML file"
    )
    parser.add_argument("--frames", type=_positive, metavar="N", help="stop after so many frames")
    parser.add_argument("--rate", type=float, metavar="HZ", help="at most so many frames a second")
    parser.add_argument("--lossless", action="store_true", help="wait for the host instead of dropping frames")
    parser.add_argument("--log-level", default="warning", choices=("debug", "info", "warning", "error"))
    return parser.parse_args(arguments)


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of frames: give 1 or more")
    return int(text)


def _warm_up(matcher: str, labels: int, filters: FilterChain | None) -> None:
    """Begin to compile matcher and filters, and say so if that takes longer than reading what was compiled before."""
    begun = [warm_up(matcher, labels), None if filters is None else warm_up_filters(filters)]
    compiling = [thread for thread in begun if thread is not None]
    until_s = time.monotonic() + _SOON_S
    for thread in compiling:
        thread.join(max(0.0, until_s - time.monotonic()))
    if any(thread.is_alive() for thread in compiling):
        print("compiling the matcher for this processor: some seconds, this once", file=sys.stderr, flush=True)


def _serve(options: argparse.Namespace) -> None:
    if options.rate is not None and not 0 < options.rate <= 1000:
        raise UsageError(f"--rate {options.rate:g}: give frames per second, above 0 and up to 1000")
    matcher = create(options.matcher)
    filters = None if options.filters is None else chain(options.filters)
    sensor = open_sensor(options.sensor, frames=options.frames, rate_hz=options.rate)
    try:
        calibration = _calibration(options.calibration, sensor)
        source = CameraSource(sensor, Pipeline(calibration, matcher, filters=filters))
        identity = DeviceIdentity(uuid.getnode().to_bytes(8, "big"), secrets.randbits(32))
        _warm_up(options.matcher, calibration.range.labels, filters)
        with _link(options) as link:
            service = Service(source, link, identity, flash.pack(calibration), lossless=options.lossless)
            _stop_on_signals(service)
            _tell({"listening": link.name})
            try:
                service.run()
            finally:
                _tell({"statistics": asdict(service.statistics)})
    finally:
        sensor.close()


def _stop_on_signals(service: Service) -> None:
    def stop(number: int, frame: object) -> None:
        del number, frame
        service.stop()

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)


def _tell(line: dict[str, object]) -> None:
    try:
        print(json.dumps(line), flush=True)
    except BrokenPipeError:  # whoever started us is gone; the counters have no reader
        sys.stdout = sys.stderr


def _calibration(path: Path | None, sensor: Sensor) -> Calibration:
    if path is None:
        if sensor.rig is None:
            raise UsageError("this sensor does not know its rig: give the unit's calibration with --calibration FILE")
        return Calibration.nominal(sensor.rig)
    try:
        if path.stat().st_size > _MOST_CALIBRATION_BYTES:
            raise UsageError(
                f"{path} has {path.stat().st_size} bytes: a calibration has at most {_MOST_CALIBRATION_BYTES}"
            )
        content = path.read_bytes()
    except OSError as error:
        raise UsageError(f"cannot read the calibration {path}: {error.strerror}") from error
    return schema.decode(content, str(path)) if content.lstrip()[:1] == b"{" else flash.unpack(content)


def _link(options: argparse.Namespace) -> Link:
    if options.link == "pty":
        from prismstereo_device.link.pty_port import PtyPort

        return PtyPort(options.symlink)
    if options.link.startswith("tcp:"):
        from prismstereo_device.link.tcp import TcpServer

        host, _, port = options.link.removeprefix("tcp:").removeprefix("//").rpartition(":")
        if not port.isdigit() or int(port) > 65535:
            raise UsageError(
                f"--link {options.link}: give tcp:HOST:PORT, e.g. tcp:127.0.0.1:4000; port 0 takes a free one"
            )
        return TcpServer(host or "127.0.0.1", int(port))
    from prismstereo_device.link.serial_port import DEFAULT_BAUD, SerialPort

    return SerialPort(options.link, options.baud or DEFAULT_BAUD)


if __name__ == "__main__":
    main()
