"""`prismstereo devices`: which ports there are, and who is on one of them."""

from __future__ import annotations

import click

from prismstereo.cli.output import json_option, say


@click.command("devices", epilog="Example:  prismstereo devices /dev/ttyACM0")
@click.argument("port", required=False)
@click.option("--timeout", default=5.0, show_default=True, type=click.FloatRange(0.1, 60), help="Seconds to wait.")
@json_option
def command(port: str | None, timeout: float, as_json: bool) -> None:
    """List the serial ports of this machine, or ask the sensor on PORT (serial or tcp:HOST:PORT) who it is."""
    if port is None:
        _list(as_json=as_json)
    else:
        _ask(port, timeout, as_json=as_json)


def _list(*, as_json: bool) -> None:
    from serial.tools import list_ports

    ports = [
        {"port": found.device, "description": found.description or "", "serial_number": found.serial_number}
        for found in sorted(list_ports.comports(), key=lambda found: str(found.device))
    ]
    lines = [f"{entry['port']}  {entry['description']}" for entry in ports]
    say({"ports": ports}, lines or ["no serial port on this machine; `prismstereo demo` needs none"], as_json=as_json)


def _ask(port: str, timeout_s: float, *, as_json: bool) -> None:
    from prismstereo.driver import StereoCamera
    from prismstereo_calibration.rectification import rectification

    with StereoCamera.open(port, timeout_s=timeout_s) as camera:
        identity, calibration = camera.identity, camera.calibration
    window = rectification(calibration).window
    result: dict[str, object] = {
        "port": port,
        "device_id": identity.device_id.hex(),
        "boot_id": identity.boot_id,
        "protocol_version": identity.version,
        "mtu": identity.mtu,
        "rig": calibration.rig,
        "calibration_hash": identity.calibration_hash.hex(),
        "baseline_mm": calibration.baseline,
        "range_min_mm": window.nearest,
        "range_max_mm": window.farthest,
    }
    say(
        result,
        [
            f"{port}: device {result['device_id']}, protocol {identity.version}, packets of {identity.mtu} bytes",
            f"  {calibration.rig}, baseline {calibration.baseline:.2f} {calibration.unit}, "
            f"{window.nearest:.0f} to {window.farthest:.0f} {calibration.unit}",
        ],
        as_json=as_json,
    )
