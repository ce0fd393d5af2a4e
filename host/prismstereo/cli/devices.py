"""`prismstereo devices`: which ports there are, which of them is a sensor, and how a sensor is."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from prismstereo.cli.baud import baud_option
from prismstereo.cli.output import json_option, say
from prismstereo_hw.errors import DataError, UsageError

if TYPE_CHECKING:
    from prismstereo.camera_settings import Setting
    from prismstereo.driver import StereoCamera
    from prismstereo_calibration.model import Calibration
    from prismstereo_device.protocol import Health

_HEALTH_S = 2.5  # a report comes once a second
_TOLD = ("product", "serial", "name", "version", "sensor", "stamp_quality")


@click.command("devices", epilog="Example:  prismstereo devices /dev/ttyACM0")
@click.argument("target", required=False)
@click.option("--timeout", default=5.0, show_default=True, type=click.FloatRange(0.1, 60), help="Seconds to wait.")
@baud_option
@json_option
def command(target: str | None, timeout: float, baud: int | None, as_json: bool) -> None:
    """List the serial ports of this machine and the sensors on USB, or ask the sensor at TARGET who and how it is.

    TARGET is a serial port (/dev/ttyACM0, COM3), serial:NUMBER as listed, tcp:HOST:PORT, a recording (*.mcap), or
    simulated[:RIG[:SCENE]]. Verbs that take a TARGET take the one sensor on USB where none is given.
    """
    if target is None:
        _list(as_json=as_json)
    else:
        _ask(target, timeout, baud, as_json=as_json)


def _list(*, as_json: bool) -> None:
    from prismstereo.discovery import found_ports

    ports = found_ports()
    lines = [
        f"{found.port}  {f'prismstereo sensor, serial:{found.serial_number}' if found.sensor else found.description}"
        for found in ports
    ]
    told = [asdict(found) for found in ports]
    say({"ports": told}, lines or ["no serial port on this machine; `prismstereo demo` needs none"], as_json=as_json)


def _ask(target: str, timeout_s: float, baud: int | None, *, as_json: bool) -> None:
    from prismstereo.opening import open_camera

    with open_camera(target, timeout_s=timeout_s, baud=baud, reconnect=False) as camera:
        result, lines = _identity(target, camera)
        details, settings = _details(camera)
        health = _health(camera)
    told = {name: details[name] for name in _TOLD if details.get(name)}
    result |= {"details": told, "settings": {one.name: asdict(one) for one in settings}}
    result["health"] = None if health is None else asdict(health)
    if told:
        lines.append("  " + ", ".join(f"{name} {value}" for name, value in told.items()))
    if health is not None:
        lines.append(_health_line(health))
    say(result, [*lines, *(_setting_line(one) for one in settings)], as_json=as_json)


def _identity(target: str, camera: StereoCamera) -> tuple[dict[str, object], list[str]]:
    identity, able = camera.identity, [str(able.name).lower() for able in camera.identity.capabilities]
    result: dict[str, object] = {
        "port": target,
        "device_id": identity.device_id.hex(),
        "boot_id": identity.boot_id,
        "protocol_version": identity.version,
        "mtu": identity.mtu,
        "can": able,
        "calibration_hash": identity.calibration_hash.hex(),
    }
    calibrated, calibration_line = _calibration(camera)
    return result | calibrated, [
        f"{target}: device {result['device_id']}, protocol {identity.version}, packets of {identity.mtu} bytes",
        calibration_line,
        f"  beyond streaming it can: {', '.join(able) or 'nothing'}",
    ]


def _calibration(camera: StereoCamera) -> tuple[dict[str, object], str]:
    from prismstereo_calibration.rectification import rectification

    if not any(camera.identity.calibration_hash):
        return {"rig": None}, "  not calibrated: write a calibration with `prismstereo flash`"
    calibration: Calibration = camera.calibration
    window = rectification(calibration).window
    return {
        "rig": calibration.rig,
        "baseline_mm": calibration.baseline,
        "range_min_mm": window.nearest,
        "range_max_mm": window.farthest,
    }, (
        f"  {calibration.rig}, baseline {calibration.baseline:.2f} {calibration.unit}, "
        f"{window.nearest:.0f} to {window.farthest:.0f} {calibration.unit}"
    )


def _details(camera: StereoCamera) -> tuple[dict[str, object], list[Setting]]:
    """Give the identity object and the settings, as far as the camera has them: a recording can be asked for no setting."""
    details: dict[str, object] = {}
    with suppress(DataError, UsageError):
        details = camera.identity_details
        return details, list(camera.settings.values())
    return details, []


def _health(camera: StereoCamera) -> Health | None:
    from prismstereo_device.wire import Channel

    known = camera.statistics.health
    if known is not None:
        return known
    with camera.stream(Channel.HEALTH, newest=1) as reports:
        return reports.take(_HEALTH_S)


def _health_line(health: Health) -> str:
    warm = "" if health.temperature_c is None else f", {health.temperature_c:.1f} C"
    coded = "exact" if not health.bound else f"within {health.bound}/16 px"
    size = ", at half resolution" if health.half_resolution else ""
    wrong = f"; last error: {health.last_error}" if health.last_error else ""
    return (
        f"  up {health.uptime_us / 1e6:.0f} s{warm}: {health.frames_captured} frames captured, {health.frames_sent} sent, "
        f"{health.frames_dropped} dropped; {coded}{size}, {health.line_bytes_per_s / 1e3:.0f} kB/s{wrong}"
    )


def _setting_line(setting: Setting) -> str:
    unit = f" {setting.unit}" if setting.unit else ""
    if setting.unavailable:
        can = setting.unavailable
    elif setting.least is not None and setting.most is not None:
        can = f"{setting.least:g} to {setting.most:g}{unit}"
    elif setting.size is not None:
        can = f"x, y, width, height inside {setting.size[0]}x{setting.size[1]} px"
    else:
        can = ", ".join(map(str, setting.choices)) or "true or false"
    also = " or auto" if setting.automatic else ""
    return f"  {setting.name} = {setting.value}  ({can}{also})  {setting.help}".rstrip()
