"""What happens on the DESK: receive, show, measure.

    import prismstereo
    with prismstereo.open() as camera:  # the sensor on USB; or "/dev/ttyACM0", "tcp:...", "take.mcap", "simulated"
        for frame in camera:
            print(frame.age_us, frame.depth_mm)

Names are loaded when they are first used, so that importing this package costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prismstereo.asyncio_camera import AsyncStereoCamera
    from prismstereo.camera_frame import CameraFrame
    from prismstereo.camera_settings import Setting
    from prismstereo.clock import ClockMapping
    from prismstereo.cloud import PointCloud
    from prismstereo.discovery import found_sensors
    from prismstereo.driver import StereoCamera
    from prismstereo.opening import open_camera as open
    from prismstereo.requests import OutcomeUnknown
    from prismstereo.still import StillPicture
    from prismstereo_calibration.model import Calibration
    from prismstereo_device.disparity import DisparityMap
    from prismstereo_device.pipeline import Pipeline
    from prismstereo_hw.errors import PrismStereoError
    from prismstereo_hw.frame import RawFrame
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.session import Session
    from prismstereo_hw.twin import Twin

__all__ = [
    "AsyncStereoCamera",
    "Calibration",
    "CameraFrame",
    "ClockMapping",
    "DisparityMap",
    "OutcomeUnknown",
    "Pipeline",
    "PointCloud",
    "PrismStereoError",
    "RawFrame",
    "Rig",
    "Session",
    "Setting",
    "StereoCamera",
    "StillPicture",
    "Twin",
    "found_sensors",
    "open",
]
__version__ = "0.1.0"

_HOMES = {
    "AsyncStereoCamera": "prismstereo.asyncio_camera",
    "Calibration": "prismstereo_calibration.model",
    "CameraFrame": "prismstereo.camera_frame",
    "ClockMapping": "prismstereo.clock",
    "DisparityMap": "prismstereo_device.disparity",
    "OutcomeUnknown": "prismstereo.requests",
    "Pipeline": "prismstereo_device.pipeline",
    "PointCloud": "prismstereo.cloud",
    "PrismStereoError": "prismstereo_hw.errors",
    "RawFrame": "prismstereo_hw.frame",
    "Rig": "prismstereo_hw.rig",
    "Session": "prismstereo_hw.session",
    "Setting": "prismstereo.camera_settings",
    "StereoCamera": "prismstereo.driver",
    "StillPicture": "prismstereo.still",
    "Twin": "prismstereo_hw.twin",
    "found_sensors": "prismstereo.discovery",
}


def __getattr__(name: str) -> object:
    """Load a public name from its home on first use."""
    if name == "open":
        return import_module("prismstereo.opening").open_camera
    if name not in _HOMES:
        raise AttributeError(f"module 'prismstereo' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
