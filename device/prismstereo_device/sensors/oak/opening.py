"""An OAK camera found, opened and started, and what it says of itself."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Generic, TypeVar

from prismstereo_device.sensors.base import SensorMode
from prismstereo_device.sensors.oak.options import OakOptions
from prismstereo_hw.errors import DeviceError, PrismStereoError, UsageError

__all__ = ["OakCamera", "Running", "open_device", "run"]

logger = logging.getLogger(__name__)

Ports = TypeVar("Ports")


@dataclass(frozen=True, slots=True)
class OakCamera:
    """One image sensor of an opened device: its modes, whether a motor drives its lens, and where that is to be locked."""

    platform: str
    device_id: str
    modes: tuple[SensorMode, ...]
    has_motor: bool
    focus: int | None

    @classmethod
    def of(cls, dai: ModuleType, device: Any, options: OakOptions) -> OakCamera:
        """Ask the device; `DeviceError` where there is no image sensor at the socket that was asked for."""
        features = {feature.socket.name: feature for feature in device.getConnectedCameraFeatures()}
        found = features.get(options.socket)
        if found is None:
            raise DeviceError(
                f"this OAK has no camera at {options.socket}, but at {', '.join(sorted(features)) or 'none'}: give socket=NAME"
            )
        modes = tuple(SensorMode(mode.width, mode.height, mode.type.name, mode.maxFps) for mode in found.configs)
        has_motor = bool(found.hasAutofocus)
        if options.lens is not None and not has_motor:
            logger.warning("lens=%d: this OAK's lens has no motor, its focus is where it was turned to", options.lens)
        return cls(
            platform=device.getPlatformAsString(),
            device_id=device.getDeviceId(),
            modes=modes,
            has_motor=has_motor,
            focus=_focus(dai, device, options) if has_motor else None,
        )


@dataclass(frozen=True, slots=True)
class Running(Generic[Ports]):
    """A started graph: its queues, its camera, the chip's temperature, and the way to stop it."""

    ports: Ports
    camera: OakCamera
    chip_c: Callable[[], float | None]
    stop: Callable[[], None]


def open_device(dai: ModuleType, name: str) -> Any:
    """Open a device by ID, IP address or USB path, or the first one; `DeviceError` tells what to check."""
    try:
        if name:
            return dai.Device(dai.DeviceInfo(name))
        found, info = dai.Device.getAnyAvailableDevice()
        if found:
            return dai.Device(info)
    except RuntimeError as error:
        raise DeviceError(_not_there(name, f" ({str(error).strip()})")) from error
    raise DeviceError(_not_there(name, ""))


def run(
    dai: ModuleType, name: str, look: Callable[[Any], OakCamera], build: Callable[[Any, OakCamera], Ports]
) -> Running[Ports]:
    """Open a device, `look` at it, `build` a graph in its pipeline and start that; closed again where any of it fails."""
    device = open_device(dai, name)
    try:
        _listen(dai, device)
        camera = look(device)
        pipeline = dai.Pipeline(device)
        ports = build(pipeline, camera)
        pipeline.start()
    except RuntimeError as error:
        device.close()
        raise DeviceError(
            f"the OAK camera does not start: {str(error).strip()}: try fewer pixels or a lower rate, and stills=0"
        ) from error
    except PrismStereoError:
        device.close()
        raise

    def stop() -> None:
        for end in (pipeline.stop, device.close):
            with suppress(RuntimeError):  # a camera that went away cannot be stopped any more
                end()

    return Running(ports, camera, lambda: _chip_c(device), stop)


def _listen(dai: ModuleType, device: Any) -> None:
    """Take what the device has to say into our log, and its loss into our hands: by itself it prints to standard output."""
    device.setLogOutputLevel(dai.LogLevel.OFF)
    device.setLogLevel(dai.LogLevel.WARN)
    device.setMaxReconnectionAttempts(0)  # we open it again ourselves: settings and numbers have to go on
    device.addLogCallback(lambda said: logger.warning("OAK: %s", said.payload))


def _chip_c(device: Any) -> float | None:
    try:
        return float(device.getChipTemperature().average)
    except RuntimeError:
        return None


def _focus(dai: ModuleType, device: Any, options: OakOptions) -> int:
    """Return where the lens is to be locked: where it was asked for, else where the factory calibrated it."""
    if options.lens is not None:
        return options.lens
    position = 0
    with suppress(RuntimeError):  # no calibration, no position
        position = int(
            device.readCalibrationOrDefault().getLensPosition(getattr(dai.CameraBoardSocket, options.socket))
        )
    if not 0 < position <= 255:
        raise UsageError(
            "this OAK's lens is driven by a motor, and its factory left no position: lock it with lens=0 to 255"
        )
    return position


def _not_there(name: str, why: str) -> str:
    asked = f"the OAK camera {name!r}" if name else "an OAK camera"
    return (
        f"{asked} is not there{why}: check its cable (USB 3, no hub) and its power, and on Linux the udev rule for USB vendor "
        "03e7; a network camera is named by its address, oak:192.168.1.20; another program may hold it"
    )
