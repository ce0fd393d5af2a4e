"""Frames with known truth for the tests of export: a wall before a small rig without glass, and its picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.rig import Rig

WALL_MM = 800.0
UNMATCHED = (slice(0, 20), slice(None))  # its upper rows


def flat_calibration(rig: Rig) -> Calibration:
    """The rig's calibration with two pinholes for what stands before them: no glass to consider."""
    return Calibration.nominal(rig).pinholes()


def wall(made: Rectification, distance_mm: float = WALL_MM) -> NDArray[np.float64]:
    """Depth of a wall, NaN in the upper rows."""
    depth = np.full((made.height, made.width), distance_mm)
    depth[UNMATCHED] = np.nan
    return depth


def painted(made: Rectification) -> NDArray[np.uint8]:
    """A picture whose every pixel has another colour: BGR = row, column, their sum."""
    rows, columns = np.mgrid[0 : made.height, 0 : made.width]
    return np.stack([rows, columns, rows + columns], axis=-1).astype(np.uint8)


def frame_of(
    calibration: Calibration,
    depth_mm: NDArray[np.float64] | None = None,
    *,
    index: int = 0,
    timestamp_ns: int = 5_000_000_000,
    picture: bool = True,
) -> ExportFrame:
    """A frame of these depths, exact but for float32."""
    made = rectification(calibration)
    depth_mm = wall(made) if depth_mm is None else depth_mm
    disparity = (made.window.scale_px / depth_mm - made.window.offset_px).astype(np.float32)
    found = DisparityMap(disparity, replace(made.window))
    return ExportFrame.of(index, timestamp_ns, found, painted(made) if picture else None, Geometries(calibration))


def pinhole_points_m(calibration: Calibration, depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points (N, 3) in metres that these depths are, by the textbook: X = Z K^-1 (u, v, 1)."""
    made = rectification(calibration)
    K = np.array([[made.focal_px, 0, made.left.cx_px], [0, made.focal_px, made.cy_px], [0, 0, 1]])
    rows, columns = np.nonzero(np.isfinite(depth_mm))
    pixels = np.stack([columns, rows, np.ones(len(rows))])
    points: NDArray[np.float64] = (np.linalg.inv(K) @ pixels * depth_mm[rows, columns]).T / 1000
    return points
