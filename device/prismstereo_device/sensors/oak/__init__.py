"""OAK cameras through depthai 3, on RVC2 and RVC4: as a sensor of whole frames, or matching by themselves.

    oak:[ID or address][?key=value&...]      keys: see `options`; mode=capture is the safe default

depthai is imported when a camera is asked for, not before. Nothing here writes to a camera's calibration memory.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from prismstereo_calibration.model import Calibration
from prismstereo_device.sensors.base import Sensor
from prismstereo_device.sensors.oak.calibration_handover import calibration_handler
from prismstereo_device.sensors.oak.capture import OakCapture
from prismstereo_device.sensors.oak.eeprom_backup import back_up
from prismstereo_device.sensors.oak.graph import CapturePorts, StereoPorts, capture_graph, stereo_graph
from prismstereo_device.sensors.oak.library import load_depthai
from prismstereo_device.sensors.oak.on_device_stereo import OakStereoSource, StereoPlan
from prismstereo_device.sensors.oak.opening import OakCamera, Running, run
from prismstereo_device.sensors.oak.options import OakOptions
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import RangeWish

__all__ = ["OakCapture", "OakOptions", "OakStereoSource", "open_oak", "open_oak_stereo"]


def open_oak(argument: str, *, frames: int | None = None, rate_hz: float | None = None) -> Sensor:
    """Open an OAK camera as a sensor, by what stands behind `oak:`.

    `UsageError` for options that cannot be had, `DeviceError` where the camera, or depthai, is not there.
    """
    options = OakOptions.parse(argument, rate_hz=rate_hz)
    if options.mode != "capture":
        raise UsageError(
            "mode=stereo gives disparity in place of frames, so there is nothing to match: it needs a calibration"
        )
    dai = load_depthai()

    def begin() -> Running[CapturePorts]:
        return run(
            dai,
            options.device,
            lambda device: OakCamera.of(dai, device, options),
            lambda pipeline, camera: capture_graph(dai, pipeline, options, focus=camera.focus),
        )

    return OakCapture(dai, begin, options, frames=frames)


def open_oak_stereo(
    argument: str,
    calibration: Calibration,
    *,
    backup_folder: Path,
    wish: RangeWish | None = None,
    frames: int | None = None,
    rate_hz: float | None = None,
) -> OakStereoSource:
    """Open an OAK camera that matches by itself, with a unit's calibration and a range (default: the calibration's).

    What the camera's own calibration memory holds is written to `backup_folder` first. Errors as of `open_oak`, and
    `CalibrationError` for a calibration of another size or focus.
    """
    options = OakOptions.parse(argument, rate_hz=rate_hz)
    if options.lens is None:
        options = replace(options, lens=calibration.lens_position)
    plan = StereoPlan.of(calibration, options, wish)
    dai = load_depthai()
    socket = getattr(dai.CameraBoardSocket, options.socket).value
    handler = calibration_handler(dai, plan.calibration, plan.made, socket=socket)

    def look(device: Any) -> OakCamera:
        back_up(device, backup_folder)
        camera = OakCamera.of(dai, device, options)
        plan.require_camera(camera.platform, camera.focus)
        return camera

    def begin() -> Running[StereoPorts]:
        return run(
            dai,
            options.device,
            look,
            lambda pipeline, camera: stereo_graph(
                dai, pipeline, options, plan.meshes, plan.size, handler, focus=camera.focus
            ),
        )

    return OakStereoSource(dai, begin, options, plan, frames=frames)
