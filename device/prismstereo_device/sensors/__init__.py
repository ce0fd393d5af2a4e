"""Sensors by name: each gives raw frames, one after the other."""

from __future__ import annotations

from prismstereo_device.sensors.base import Sensor
from prismstereo_hw.errors import UsageError

__all__ = ["SENSORS", "Sensor", "open_sensor"]

SENSORS = {
    "twin:RIG[:SCENE]": "the optical twin of a rig (a built-in name or a rig file) before a scene, e.g. twin:oak-1:desk",
    "replay:PATH": "a session folder, a folder of pictures, or one picture",
}


def open_sensor(address: str, *, frames: int | None = None, rate_hz: float | None = None) -> Sensor:
    """Open a sensor by address, for at most `frames` frames at most `rate_hz` fast; `UsageError` lists the kinds."""
    kind, _, argument = address.partition(":")
    if kind == "twin" and argument:
        from prismstereo_device.sensors.twin import TwinSensor

        return TwinSensor.parse(argument, frames=frames, rate_hz=rate_hz)
    if kind == "replay" and argument:
        from prismstereo_device.sensors.replay import ReplaySensor

        return ReplaySensor(argument, frames=frames, rate_hz=rate_hz)
    raise UsageError(f"there is no sensor {address!r}: give {' or '.join(SENSORS)}")
