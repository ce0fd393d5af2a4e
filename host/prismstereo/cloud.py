"""The point cloud: metric points of one disparity map, and its binary PLY file.

Frame: the rectified left camera, x right, y down, z forward; unit: the calibration's (millimetres, or board squares).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.rectification import Rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.errors import ImageError
from prismstereo_hw.files import write_whole

__all__ = ["PointCloud", "point_cloud"]


@dataclass(frozen=True, slots=True)
class PointCloud:
    """Points (N, 3) float32 of the rectified left frame, in `unit`, and their colours (N, 3) uint8 RGB if there are any."""

    points: NDArray[np.float32]
    colours: NDArray[np.uint8] | None = None
    unit: str = "mm"

    def ply(self) -> bytes:
        """Return the cloud as the bytes of a binary little-endian PLY file; unit and frame stand in its comments."""
        fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
        names = ["property float x", "property float y", "property float z"]
        if self.colours is not None:
            fields += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
            names += ["property uchar red", "property uchar green", "property uchar blue"]
        rows = np.empty(len(self.points), dtype=fields)
        for axis, name in enumerate("xyz"):
            rows[name] = self.points[:, axis]
        if self.colours is not None:
            for channel, name in enumerate(("red", "green", "blue")):
                rows[name] = self.colours[:, channel]
        header = [
            "ply",
            "format binary_little_endian 1.0",
            f"comment unit {self.unit}",
            "comment frame rectified left camera: x right, y down, z forward",
            f"element vertex {len(rows)}",
            *names,
            "end_header",
        ]
        return ("\n".join(header) + "\n").encode("ascii") + rows.tobytes()

    def write(self, path: str | Path) -> None:
        """Write the cloud as a PLY file, whole or not at all."""
        write_whole(path, self.ply())


def point_cloud(
    disparity: DisparityMap, rectification: Rectification, picture: NDArray[np.uint8] | None = None
) -> PointCloud:
    """Triangulate every matched pixel with a finite depth.

    `picture` (height, width) grey or (height, width, 3) BGR is the rectified left picture, and paints the points.
    """
    depth = rectification.window.depth_map(disparity.disparity_px)
    if depth.shape != (rectification.height, rectification.width):
        raise ImageError(
            f"the disparity map is {depth.shape[1]}x{depth.shape[0]}, but this calibration's rectified pictures are "
            f"{rectification.width}x{rectification.height}: it belongs to another calibration"
        )
    kept = np.isfinite(depth)
    colours = None
    if picture is not None:
        rgb = picture[..., ::-1] if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
        colours = np.ascontiguousarray(rgb[kept])
    return PointCloud(rectification.points(np.where(kept, depth, 0))[kept], colours, rectification.unit)
