"""What happens on the DESK: receive, show, measure.

    import prismstereo
    with prismstereo.StereoCamera.open("/dev/ttyACM0") as camera:
        for frame in camera:
            print(frame.disparity.density)

Names are loaded when they are first used, so that importing this package costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prismstereo.cloud import PointCloud
    from prismstereo.driver import StereoCamera
    from prismstereo_calibration.model import Calibration
    from prismstereo_device.disparity import DisparityMap
    from prismstereo_device.pipeline import Pipeline
    from prismstereo_hw.errors import PrismStereoError
    from prismstereo_hw.frame import RawFrame
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.session import Session
    from prismstereo_hw.twin import Twin

__all__ = [
    "Calibration",
    "DisparityMap",
    "Pipeline",
    "PointCloud",
    "PrismStereoError",
    "RawFrame",
    "Rig",
    "Session",
    "StereoCamera",
    "Twin",
]
__version__ = "0.1.0"

_HOMES = {
    "Calibration": "prismstereo_calibration.model",
    "DisparityMap": "prismstereo_device.disparity",
    "Pipeline": "prismstereo_device.pipeline",
    "PointCloud": "prismstereo.cloud",
    "PrismStereoError": "prismstereo_hw.errors",
    "RawFrame": "prismstereo_hw.frame",
    "Rig": "prismstereo_hw.rig",
    "Session": "prismstereo_hw.session",
    "StereoCamera": "prismstereo.driver",
    "Twin": "prismstereo_hw.twin",
}


def __getattr__(name: str) -> object:
    """Load a public name from its home on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'prismstereo' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
