"""Sensors by name: each gives raw frames, one after the other."""

from __future__ import annotations

import math

from prismstereo_device.sensors.base import Sensor
from prismstereo_hw.errors import UsageError

__all__ = ["SENSORS", "Sensor", "open_sensor"]

SENSORS = {
    "twin:RIG[:SCENE]": "the optical twin of a rig (a built-in name or a rig file) before a scene, e.g. twin:oak-1:desk",
    "replay:PATH": "a session folder, a folder of pictures, or one picture",
}


def open_sensor(address: str, *, frames: int | None = None, rate_hz: float | None = None) -> Sensor:
    """Open a sensor by address, for at most `frames` frames at most `rate_hz` fast; `UsageError` lists the kinds."""
    if frames is not None and frames < 0:
        raise UsageError(f"{frames} frames: give 0 or more, or none for all there are")
    if rate_hz is not None and not 0 < rate_hz < math.inf:
        raise UsageError(f"a rate of {rate_hz:g} frames per second: give a positive one, or none for no limit")
    kind, _, argument = address.partition(":")
    if kind == "twin" and argument:
        from prismstereo_device.sensors.twin import TwinSensor

        return TwinSensor.parse(argument, frames=frames, rate_hz=rate_hz)
    if kind == "replay" and argument:
        from prismstereo_device.sensors.replay import ReplaySensor

        return ReplaySensor(argument, frames=frames, rate_hz=rate_hz)
    raise UsageError(f"there is no sensor {address!r}: give {' or '.join(SENSORS)}")
