"""One verb for every sensor: on USB, on a serial port, on the network, in a recording, or simulated; the same object each."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import ExitStack

from prismstereo.discovery import PortInfo, sensor_port, the_only_sensor
from prismstereo.driver import StereoCamera
from prismstereo_device.link import Link, open_link
from prismstereo_hw.errors import UsageError

__all__ = ["TARGETS", "open_camera"]

TARGETS = "/dev/ttyACM0, COM3, serial:NUMBER, tcp:HOST:PORT, RECORDING.mcap, or simulated[:RIG[:SCENE]]"

_REOPEN_S = 1.0
_STARTING_S = 30.0  # a simulated sensor has a picture to compute first
_RECORDING = ".mcap"
_SIMULATED = "simulated"
_SERIAL = "serial:"
_DEFAULT_RIG = "oak-1"
_SIMULATED_HZ = 15.0  # rendering leaves the rest of the machine to whoever looks


def open_camera(
    target: str | os.PathLike[str] | None = None,
    *,
    timeout_s: float = 5.0,
    baud: int | None = None,
    silence_s: float = 3.0,
    queue_frames: int = 8,
    keep_all: bool = False,
    reconnect: bool = True,
    listing: Callable[[], Iterable[PortInfo]] | None = None,
) -> StereoCamera:
    """Open a sensor; `prismstereo.open` is this.

    `target` is a serial port (`/dev/ttyACM0`, `COM3`), `serial:NUMBER` (a sensor on USB, wherever it is plugged in),
    `tcp:HOST:PORT`, a recording (`*.mcap`), or `simulated[:RIG[:SCENE]]`, which runs the real firmware before a rendered scene.
    None is the one sensor that is plugged in over USB. `queue_frames` frames wait for a slow reader and then the oldest is
    dropped (1: always the newest), unless `keep_all` lets the camera wait, or plays a recording as fast as it is read. With
    `reconnect` a sensor that is lost is searched for; one that was found by its serial number at whatever port it comes back.

    Raises PortError where there is nothing to open, LinkLost where nothing answers within `timeout_s`, DeviceError where no
    sensor is plugged in, UsageError where there are several, DataError for what is no recording.
    """
    name = None if target is None else os.fspath(target)
    if name is not None and _is(name, _SIMULATED):
        return _simulated(name, timeout_s, silence_s=silence_s, queue_frames=queue_frames, keep_all=keep_all)
    if name is not None and (name.endswith(_RECORDING) or os.path.isfile(name)):
        return _recorded(name, timeout_s, silence_s=silence_s, queue_frames=queue_frames, keep_all=keep_all)
    opener = _opener(name, baud, listing)
    link = opener(timeout_s)
    try:
        return StereoCamera(
            link,
            timeout_s,
            silence_s=silence_s,
            queue_frames=queue_frames,
            keep_all=keep_all,
            reopen=(lambda: opener(_REOPEN_S)) if reconnect else None,
        )
    except BaseException:
        link.close()
        raise


def _is(name: str, kind: str) -> bool:
    return name == kind or name.startswith(f"{kind}:")


def _opener(
    name: str | None, baud: int | None, listing: Callable[[], Iterable[PortInfo]] | None
) -> Callable[[float], Link]:
    """Give what opens the port, now and again: one that may have moved is looked for each time."""
    serial_number = ""
    if name is None:
        found = the_only_sensor(listing)
        name, serial_number = found.port, found.serial_number
    elif name.startswith(_SERIAL):
        serial_number = name.removeprefix(_SERIAL)
        if not serial_number:
            raise UsageError("serial: without a number: give one that `prismstereo devices` lists")
    port = name

    def opened(timeout_s: float) -> Link:
        where = sensor_port(serial_number, listing) if serial_number else port
        return open_link(where, baud=baud, timeout_s=timeout_s)

    return opened


def _simulated(name: str, timeout_s: float, *, silence_s: float, queue_frames: int, keep_all: bool) -> StereoCamera:
    from prismstereo.simulated import SimulatedDevice
    from prismstereo_device.sensors import open_sensor

    sensor = f"twin:{name.partition(':')[2] or _DEFAULT_RIG}"
    open_sensor(sensor).close()  # a rig or a scene that there is not is told at once
    rate_hz = None if keep_all else _SIMULATED_HZ
    with ExitStack() as undoing:
        device = SimulatedDevice(sensor, lossless=keep_all, rate_hz=rate_hz, log_level="error")
        undoing.callback(device.stop)
        link = undoing.enter_context(open_link(device.address, timeout_s=timeout_s))
        camera = StereoCamera(
            link,
            max(timeout_s, _STARTING_S),
            silence_s=silence_s,
            queue_frames=queue_frames,
            keep_all=keep_all,
            after_close=device.stop,
        )
        undoing.pop_all()
    return camera


def _recorded(name: str, timeout_s: float, *, silence_s: float, queue_frames: int, keep_all: bool) -> StereoCamera:
    from prismstereo.recording import replay

    pace = None if keep_all else 1.0
    return replay(
        name, pace=pace, timeout_s=timeout_s, silence_s=silence_s, queue_frames=queue_frames, keep_all=keep_all
    )
