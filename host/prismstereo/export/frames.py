"""One frame on its way to a file, from wherever it comes: disparity, picture, and the geometry that they stand in."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.cloud import PointCloud
from prismstereo.export.geometry import FrameGeometry, Geometries
from prismstereo_device.disparity import DisparityMap

__all__ = ["ExportFrame"]


@dataclass(frozen=True, slots=True)
class ExportFrame:
    """A frame: its number, its stamp in nanoseconds, its disparity map, and how that becomes metric.

    `left` is the rectified left picture of the map's size, (height, width) uint8 grey or (height, width, 3) BGR, or None
    where none was kept. The stamp is of the camera's own clock, mid-exposure.
    """

    index: int
    timestamp_ns: int
    disparity: DisparityMap
    left: NDArray[np.uint8] | None
    geometry: FrameGeometry

    @classmethod
    def of(
        cls,
        index: int,
        timestamp_ns: int,
        disparity: DisparityMap,
        left: NDArray[np.uint8] | None,
        geometries: Geometries,
    ) -> ExportFrame:
        """Give a map its geometry, and its picture the map's size; DataError where they are of another calibration."""
        geometry = geometries.of(disparity)
        if left is not None and left.shape[:2] != (geometry.height, geometry.width):
            left = np.asarray(cv2.resize(left, (geometry.width, geometry.height), interpolation=cv2.INTER_AREA))
        return cls(index, timestamp_ns, disparity, left, geometry)

    @property
    def inverse_px(self) -> NDArray[np.float32]:
        """Disparity + offset, glass considered: (height, width) float32 pixels, focal * baseline / depth; NaN unmatched."""
        found, glass = self.disparity.disparity_px, self.geometry.window.glass
        if glass is not None:
            found = found + glass.missing_px(found)
        return np.asarray(found + np.float32(self.geometry.offset_px), np.float32)

    @property
    def depth(self) -> NDArray[np.float32]:
        """Depth along the optical axis (height, width) float32 in the calibration's unit; NaN unmatched, inf beyond all."""
        return self.geometry.window.depth_map(self.disparity.disparity_px)

    def cloud(self, scale: float = 1.0) -> PointCloud:
        """Give the points of finite depth, row by row, in the calibration's unit times `scale`, painted by the picture."""
        depth = self.depth
        kept = np.isfinite(depth)
        points = self.geometry.points(np.where(kept, depth, np.float32(0)))[kept] * scale
        return PointCloud(points.astype(np.float32), self.colours(kept), self.geometry.unit)

    def colours(self, kept: NDArray[np.bool_]) -> NDArray[np.uint8] | None:
        """Give the colours (N, 3) uint8 RGB of chosen pixels; None where there is no picture."""
        if self.left is None:
            return None
        rgb = self.left[..., ::-1] if self.left.ndim == 3 else np.repeat(self.left[..., None], 3, axis=2)
        return np.ascontiguousarray(rgb[kept])
