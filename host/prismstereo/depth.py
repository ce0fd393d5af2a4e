"""Depth of one raw frame on the desk: what the camera would send, and what people want to have of it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from prismstereo.cloud import PointCloud, point_cloud
from prismstereo.picture import depth_picture
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw import pfm
from prismstereo_hw.files import write_picture
from prismstereo_hw.frame import RawFrame

__all__ = ["FrameDepth", "depth_of"]


@dataclass(frozen=True, slots=True)
class FrameDepth:
    """One frame's results; `depth` (height, width) float32 along the rectified z axis in `unit`, NaN where unmatched."""

    disparity: DisparityMap
    depth: NDArray[np.float32]
    cloud: PointCloud
    unit: str
    milliseconds: float

    @property
    def median_depth(self) -> float:
        """Median of the finite depths, NaN if there is none."""
        known = self.depth[np.isfinite(self.depth)]
        return float(np.median(known)) if known.size else float("nan")

    def write(self, folder: Path, name: str) -> list[Path]:
        """Write NAME_disparity.pfm, NAME_depth.pfm, NAME_depth.png (the picture) and NAME.ply; return their paths."""
        paths = [folder / f"{name}{ending}" for ending in ("_disparity.pfm", "_depth.pfm", "_depth.png", ".ply")]
        pfm.write_disparity(paths[0], self.disparity.disparity_px)
        pfm.write(paths[1], self.depth)
        write_picture(paths[2], depth_picture(self.disparity, self.unit))
        self.cloud.write(paths[3])
        return paths


def depth_of(pipeline: Pipeline, frame: RawFrame) -> FrameDepth:
    """Split, rectify, match and triangulate one raw frame; `CalibrationError` when it is not of this calibration."""
    begin = time.perf_counter()
    pair = pipeline.split(frame)
    disparity = pipeline.disparity(pair)
    milliseconds = 1e3 * (time.perf_counter() - begin)
    cloud = point_cloud(disparity, pipeline.rectifier.rectification, pipeline.rectifier.left_picture(pair))
    return FrameDepth(disparity, disparity.depth(), cloud, pipeline.calibration.unit, milliseconds)
