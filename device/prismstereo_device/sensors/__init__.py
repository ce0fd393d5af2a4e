"""Sensors by name: each gives raw frames, one after the other."""

from __future__ import annotations

import math

from prismstereo_device.sensors.base import Sensor
from prismstereo_hw.errors import UsageError

__all__ = ["SENSORS", "Sensor", "open_sensor"]

SENSORS = {
    "twin:RIG[:SCENE]": "the optical twin of a rig (a built-in name or a rig file) before a scene, e.g. twin:oak-1:desk",
    "replay:PATH[?loop=1&pace=recorded]": "a session folder, a video, a folder of pictures, or one picture",
    "v4l2:DEVICE[?width=W&height=H&...]": "a USB or CSI camera or an HDMI grabber, e.g. v4l2:/dev/video0?rig=oak-1",
    "url:ADDRESS[#rig=RIG]": "a network camera, e.g. url:rtsp://192.168.1.20/stream",
    "picamera2:[INDEX][?rate=HZ&...]": "a Raspberry Pi camera, e.g. picamera2:0?rig=pi-camera-v2",
    "oak:[ID][?key=value&...]": "an OAK camera, e.g. oak:?rig=oak-1",
}


def open_sensor(address: str, *, frames: int | None = None, rate_hz: float | None = None) -> Sensor:
    """Open a sensor by address, for at most `frames` frames at most `rate_hz` fast; `UsageError` lists the kinds."""
    if frames is not None and frames < 0:
        raise UsageError(f"{frames} frames: give 0 or more, or none for all there are")
    if rate_hz is not None and not 0 < rate_hz < math.inf:
        raise UsageError(f"a rate of {rate_hz:g} frames per second: give a positive one, or none for no limit")
    kind, colon, argument = address.partition(":")
    found = _opened(kind, argument, frames, rate_hz) if colon else None
    if found is None:  # what stands behind the kind may hold a password, and is not said
        raise UsageError(f"there is no sensor {kind + colon!r}: give {' or '.join(SENSORS)}")
    return found


def _opened(kind: str, argument: str, frames: int | None, rate_hz: float | None) -> Sensor | None:
    """Open a sensor of a kind; None where there is no such kind, or something must stand behind it."""
    if kind == "picamera2":
        from prismstereo_device.sensors.picamera2 import PiSensor

        return PiSensor.parse(argument, frames=frames, rate_hz=rate_hz)
    if kind == "oak":
        from prismstereo_device.sensors.oak import open_oak

        return open_oak(argument, frames=frames, rate_hz=rate_hz)
    if not argument:
        return None
    if kind == "twin":
        from prismstereo_device.sensors.twin import TwinSensor

        return TwinSensor.parse(argument, frames=frames, rate_hz=rate_hz)
    if kind == "replay":
        from prismstereo_device.sensors.replay import ReplaySensor

        return ReplaySensor.parse(argument, frames=frames, rate_hz=rate_hz)
    if kind == "v4l2":
        from prismstereo_device.sensors.v4l2 import V4l2Sensor

        return V4l2Sensor.parse(argument, frames=frames, rate_hz=rate_hz)
    if kind == "url":
        from prismstereo_device.sensors.url import UrlSensor

        return UrlSensor.parse(argument, frames=frames, rate_hz=rate_hz)
    return None
