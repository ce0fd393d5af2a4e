"""Obstacle zones as a laser scan: level beams in the body frame, each as near as the nearest zone above or below it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prismstereo.export.geometry import FrameGeometry
from prismstereo.export.ros_messages import RosMessage, header
from prismstereo_device.zones import ZoneDistances

__all__ = ["laser_scan"]

_NOTHING, _FAR = 0, 65535  # in the zones' grid
_BEAMS_A_COLUMN = 4
_M_PER_MM = 1e-3


def laser_scan(zones: ZoneDistances, geometry: FrameGeometry, stamp_ns: int, frame: str, period_s: float) -> RosMessage:
    """Give the zones' columns as ranges in metres from a body frame: from right to left, as angles grow.

    As REP 117 has it, a beam is NaN where nothing was measured, and inf where nothing stands within reach.
    """
    nearest_mm = _columns(zones.nearest_mm)
    beams = _BEAMS_A_COLUMN * len(nearest_mm)
    borders = np.array([geometry.width - 0.5, -0.5])
    right, left = (float(angle) for angle in np.arctan((geometry.cx_px - borders) / geometry.focal_px))
    step = (left - right) / beams
    angles = right + step * (np.arange(beams) + 0.5)
    at = geometry.cx_px - geometry.focal_px * np.tan(angles) + 0.5
    columns = np.searchsorted(_ends(geometry.width, len(nearest_mm)), at, side="right")
    ahead_m = nearest_mm[np.clip(columns, 0, len(nearest_mm) - 1)] * _M_PER_MM
    window = geometry.window
    return RosMessage(
        "sensor_msgs/msg/LaserScan",
        {
            "header": header(stamp_ns, frame),
            "angle_min": float(angles[0]),
            "angle_max": float(angles[-1]),
            "angle_increment": step,
            "time_increment": 0.0,
            "scan_time": period_s,
            "range_min": window.nearest * geometry.metres,
            "range_max": (window.farthest if math.isfinite(window.farthest) else float(_FAR)) * geometry.metres,
            "ranges": (ahead_m / np.cos(angles)).astype(np.float32),
            "intensities": np.zeros(0, np.float32),
        },
    )


def _columns(grid: NDArray[np.uint16]) -> NDArray[np.float64]:
    """Return what each column of zones says: mm, NaN where no zone measured anything, inf where those that did see far."""
    distances = np.where(grid == _FAR, np.inf, grid.astype(np.float64))
    nearest = np.where(grid == _NOTHING, np.inf, distances).min(axis=0)
    return np.where(np.all(grid == _NOTHING, axis=0), np.nan, nearest)


def _ends(width: int, columns: int) -> NDArray[np.int64]:
    """Return where each column of zones ends: cut as the zones are, the first ones a pixel wider than the last."""
    wider = width % columns
    return np.cumsum(np.full(columns, width // columns) + (np.arange(columns) < wider))
