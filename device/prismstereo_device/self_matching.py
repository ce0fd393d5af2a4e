"""A camera that matches by itself: its disparity goes out as it comes, there are no pictures to make anything else of.

Nothing can be set while it runs. A calibration that a host writes is kept, and the service starts again with it.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from prismstereo_calibration import flash
from prismstereo_calibration.model import Calibration
from prismstereo_device.control.identity import board_temperature_c, device_id
from prismstereo_device.control.settings import Settings
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.program.assembly import (
    Assembly,
    Program,
    first_calibration,
    rate_control_of,
    shelf_of,
)
from prismstereo_device.program.configuration import Configuration
from prismstereo_device.protocol.hello import Capability
from prismstereo_device.serving.device_identity import DeviceIdentity
from prismstereo_device.source import ProducedFrame
from prismstereo_device.state import CalibrationSlots, Disk
from prismstereo_hw.errors import UsageError

__all__ = ["MatchingCamera", "SelfMatchingSource", "matches_by_itself", "open_matching_camera", "self_matching"]

_ITS_OWN = ("rate_hz", "bound")  # settings that hold for a camera that matches by itself, too
_KIND = "oak:"
_BACKUP = "eeprom"  # below the state folder: what the camera's own calibration memory held before we came


class MatchingCamera(Protocol):
    """Whatever gives disparity in place of pictures."""

    @property
    def temperature_c(self) -> float | None:
        """The chip's temperature; None where it does not tell."""
        ...

    def read(self) -> ProducedFrame | None:
        """Wait for the next frame; None after the last. `DeviceError` when the camera does not come back."""
        ...

    def close(self) -> None:
        """Let go of the camera."""
        ...


class SelfMatchingSource:
    """A matching camera as the source of a service."""

    def __init__(self, camera: MatchingCamera) -> None:
        self._camera = camera
        self._stopped = False

    @property
    def temperature_c(self) -> float | None:
        """The chip's temperature; None where it does not tell."""
        return self._camera.temperature_c

    def read(self) -> ProducedFrame | None:
        """Wait for the next frame; None after the last, or once stopped."""
        return None if self._stopped else self._camera.read()

    def stop(self) -> None:
        """Begin no more frames; from any thread."""
        self._stopped = True

    def close(self) -> None:
        """Let go of the camera; after the last `read`."""
        self._camera.close()


def matches_by_itself(address: str) -> bool:
    """Tell whether a sensor's address asks for on-device stereo; `UsageError` for an OAK's options that cannot be."""
    if not address.startswith(_KIND):
        return False
    from prismstereo_device.sensors.oak import OakOptions

    return OakOptions.parse(address.removeprefix(_KIND)).mode == "stereo"


def open_matching_camera(configuration: Configuration, calibration: Calibration) -> MatchingCamera:
    """Open the configured OAK camera; its errors, and `UsageError` without a folder for its memory's backup."""
    from prismstereo_device.sensors.oak import open_oak_stereo

    folder, rate_hz = configuration.state_folder, configuration.settings.rate_hz
    if folder is None:
        raise UsageError("on-device stereo backs the camera's own calibration up first: give --state DIR to keep it in")
    return open_oak_stereo(
        configuration.sensor.removeprefix(_KIND),
        calibration,
        backup_folder=Path(folder) / _BACKUP,
        frames=configuration.frames,
        rate_hz=None if isinstance(rate_hz, str) else rate_hz,
    )


def _refuse_what_it_cannot(configuration: Configuration) -> None:
    """Raise `UsageError` for what only our own matcher and filters do."""
    wished, plain = configuration.settings, Settings()
    asked = ["filters"] if configuration.filters else []
    asked += [
        name for name in wished.__struct_fields__ if name not in _ITS_OWN and wished.value(name) != plain.value(name)
    ]
    if asked:
        raise UsageError(
            f"{', '.join(asked)}: a camera that matches by itself does not do that; leave it out, or take its frames with "
            "mode=capture"
        )


def self_matching(
    configuration: Configuration,
    disk: Disk,
    program: Program,
    open_camera: Callable[[Configuration, Calibration], MatchingCamera] = open_matching_camera,
) -> Assembly:
    """Put a camera that matches by itself together; the errors of `assembled`, and `DeviceError` where it is not there."""
    from prismstereo_device.sensors.oak import OakOptions

    _refuse_what_it_cannot(configuration)
    slots = CalibrationSlots(disk)
    rig = OakOptions.parse(configuration.sensor.removeprefix(_KIND)).rig
    first = first_calibration(configuration, slots, rig)
    calibration = flash.unpack(first)
    size = calibration.frame_width, calibration.frame_height
    made = {ObjectNumber.LOG: program.log.content}
    shelf = shelf_of(configuration, disk, slots, first, lambda _: program.reboot(), made, lambda: size)
    source = SelfMatchingSource(open_camera(configuration, calibration))

    def warmth() -> float | None:
        own = source.temperature_c
        return board_temperature_c() if own is None else own

    return Assembly(
        source=source,
        who=DeviceIdentity(device_id(disk), secrets.randbits(32)),
        shelf=shelf,
        commands=None,
        rate_control=rate_control_of(configuration),
        compiling=(),
        offers=Capability.WRITE | Capability.PREVIEW,
        temperature_c=warmth,
    )
