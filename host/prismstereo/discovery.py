"""Which sensors are plugged in: serial ports by the USB identity of this product's cameras, each with its serial number."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from prismstereo_device.link import PortError
from prismstereo_hw.errors import DeviceError, UsageError

__all__ = ["FoundPort", "PortInfo", "found_ports", "found_sensors", "sensor_port", "the_only_sensor"]

_VENDOR, _PRODUCT = 0x1D6B, 0x0104  # the Linux gadget's own numbers, which other makers' gadgets have, too
_MAKER = "prismstereo"


class PortInfo(Protocol):
    """What the system tells of a serial port, as `serial.tools.list_ports` gives it."""

    device: str
    description: str | None
    vid: int | None
    pid: int | None
    serial_number: str | None
    manufacturer: str | None
    product: str | None


@dataclass(frozen=True, slots=True)
class FoundPort:
    """A serial port; `sensor` says whether one of our cameras is behind it, `serial_number` is then the camera's."""

    port: str
    description: str
    serial_number: str
    sensor: bool


def found_ports(listing: Callable[[], Iterable[PortInfo]] | None = None) -> list[FoundPort]:
    """List the serial ports of this machine, by name. `listing` is where to ask, by default the system."""
    return sorted(
        (
            FoundPort(info.device, info.description or "", info.serial_number or "", _is_sensor(info))
            for info in (listing or _system_ports)()
        ),
        key=lambda found: found.port,
    )


def found_sensors(listing: Callable[[], Iterable[PortInfo]] | None = None) -> list[FoundPort]:
    """List the sensors that are plugged in over USB. One on a UART or on the network cannot be seen: it is opened by name."""
    return [found for found in found_ports(listing) if found.sensor]


def the_only_sensor(listing: Callable[[], Iterable[PortInfo]] | None = None) -> FoundPort:
    """Find the one sensor that is plugged in; DeviceError where there is none, UsageError where there are several."""
    sensors = found_sensors(listing)
    if not sensors:
        raise DeviceError(
            "no sensor is plugged in over USB: plug one in, name its port (/dev/ttyACM0, COM3, tcp:HOST:PORT), or say "
            "simulated to do without"
        )
    if len(sensors) > 1:
        names = ", ".join(f"{found.port} (serial:{found.serial_number})" for found in sensors)
        raise UsageError(f"{len(sensors)} sensors are plugged in: name one of {names}")
    return sensors[0]


def sensor_port(serial_number: str, listing: Callable[[], Iterable[PortInfo]] | None = None) -> str:
    """Find the port where a sensor is plugged in now, by its serial number; PortError where it is not."""
    sensors = found_sensors(listing)
    for found in sensors:
        if found.serial_number.lower() == serial_number.lower():
            return found.port
    there = ", ".join(found.serial_number for found in sensors) or "none"
    raise PortError(f"no sensor with serial number {serial_number!r} is plugged in: there are {there}")


def _is_sensor(info: PortInfo) -> bool:
    if (info.vid, info.pid) != (_VENDOR, _PRODUCT):
        return False
    # Windows tells who made its driver, not who made the camera.
    return (info.manufacturer or "").lower() == _MAKER or sys.platform == "win32"


def _system_ports() -> list[PortInfo]:
    from serial.tools import list_ports

    return list(list_ports.comports())
