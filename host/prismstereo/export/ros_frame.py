"""One frame as ROS messages: picture, camera infos, disparity, depth, cloud; each is made only if somebody wants it.

The pictures that ROS gets are rectified on the camera, and their principal columns differ by the offset of the range window.
A `DisparityImage` is pre-adjusted for that, as its definition asks: what stands in it is disparity + offset, so Z = f T / d.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import FrameGeometry
from prismstereo.export.ros_messages import FrameNames, RosMessage, header, image
from prismstereo_calibration.convert.pair import PairCamera, StereoPairModel, pair_of
from prismstereo_calibration.model import Calibration
from prismstereo_device.disparity import FRACTION

__all__ = ["TOPICS", "DepthEncoding", "FrameMessages", "Topic"]

DepthEncoding = Literal["16UC1", "32FC1"]
_MM_PER_M = 1000.0
_DEEPEST_MM = 65535
_FLOAT32 = 7  # sensor_msgs/PointField
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
_PLAIN = np.zeros(5), np.eye(3)


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic below the sensor's namespace, and its type."""

    name: str
    kind: str


TOPICS = (
    Topic("left/image_rect", "sensor_msgs/msg/Image"),
    Topic("left/camera_info", "sensor_msgs/msg/CameraInfo"),
    Topic("right/camera_info", "sensor_msgs/msg/CameraInfo"),
    Topic("disparity", "stereo_msgs/msg/DisparityImage"),
    Topic("depth", "sensor_msgs/msg/Image"),
    Topic("points2", "sensor_msgs/msg/PointCloud2"),
)


class FrameMessages:
    """Turns frames into messages in the frames of `names`; UsageError for those of a calibration without millimetres.

    `depth` is 16UC1 (mm, 0 unmatched) or 32FC1 (m, NaN unmatched).
    """

    def __init__(self, names: FrameNames, depth: DepthEncoding = "16UC1") -> None:
        self._names = names
        self._depth = depth
        self._known: tuple[Calibration, StereoPairModel] | None = None

    def of(
        self, frame: ExportFrame, stamp_ns: int, wanted: Callable[[str], bool] | None = None
    ) -> Iterator[tuple[str, RosMessage]]:
        """Give what there is of a frame, by topic, as far as it is wanted; None: all of it."""
        left = self._names.left
        makers: dict[str, Callable[[], RosMessage]] = {
            "left/camera_info": lambda: self.camera_info("left", frame.geometry, stamp_ns),
            "right/camera_info": lambda: self.camera_info("right", frame.geometry, stamp_ns),
            "disparity": lambda: disparity_image(frame, stamp_ns, left),
            "depth": lambda: image(_depth(frame, self._depth), stamp_ns, left),
            "points2": lambda: point_cloud2(frame, stamp_ns, left),
        }
        if frame.left is not None:
            picture = frame.left
            makers["left/image_rect"] = lambda: image(_grey(picture), stamp_ns, left)
        for topic, make in makers.items():
            if wanted is None or wanted(topic):
                yield topic, make()

    def camera_info(self, side: Literal["left", "right"], geometry: FrameGeometry, stamp_ns: int) -> RosMessage:
        """Give K, D and R of a view's own picture and P of the rectified one; P[0, 3] of the right one is -f B in metres.

        Where the view's own picture has another size than the rectified one (half resolution, interlaced views), ROS cannot
        say both, and K is that of the rectified picture.
        """
        pair = self._pair(geometry.calibration)
        camera = pair.left if side == "left" else pair.right
        f, cy = geometry.focal_px, geometry.cy_px
        cx = geometry.cx_px if side == "left" else geometry.cx_right_px
        shift = 0.0 if side == "left" else -f * geometry.baseline_m
        P = np.array([[f, 0.0, cx, shift], [0.0, f, cy, 0.0], [0.0, 0.0, 1.0, 0.0]])
        K, (D, R) = P[:, :3], _PLAIN
        if _same_size(camera, geometry):
            K, D, R = camera.lens.K, np.array(camera.lens.distortion, float), _turn(pair, side)
        return RosMessage(
            "sensor_msgs/msg/CameraInfo",
            {
                "header": header(stamp_ns, self._names.left),
                "height": geometry.height,
                "width": geometry.width,
                "distortion_model": "plumb_bob",
                "d": D,
                "k": np.ascontiguousarray(K, np.float64).reshape(-1),
                "r": np.ascontiguousarray(R, np.float64).reshape(-1),
                "p": P.reshape(-1),
                "binning_x": 0,
                "binning_y": 0,
                "roi": _region(0, 0),
            },
        )

    def _pair(self, calibration: Calibration) -> StereoPairModel:
        if self._known is None or self._known[0] is not calibration:
            self._known = calibration, pair_of(calibration)
        return self._known[1]


def _turn(pair: StereoPairModel, side: Literal["left", "right"]) -> NDArray[np.float64]:
    rectified = pair.rectified
    assert rectified is not None  # a pair that was made of a calibration
    return rectified.R_left if side == "left" else rectified.R_right


def _same_size(camera: PairCamera, geometry: FrameGeometry) -> bool:
    return camera.size == (geometry.width, geometry.height) and camera.row_step == 1


def _region(width: int, height: int) -> RosMessage:
    fields = {"x_offset": 0, "y_offset": 0, "height": height, "width": width, "do_rectify": False}
    return RosMessage("sensor_msgs/msg/RegionOfInterest", fields)


def _grey(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)


def _depth(frame: ExportFrame, encoding: DepthEncoding) -> NDArray[np.uint16] | NDArray[np.float32]:
    millimetres = frame.depth * np.float32(frame.geometry.metres * _MM_PER_M)
    if encoding == "32FC1":
        return np.asarray(millimetres / np.float32(_MM_PER_M), np.float32)
    near = np.isfinite(millimetres) & (millimetres < _DEEPEST_MM)
    return np.where(near, np.rint(np.where(near, millimetres, 0)), 0).astype(np.uint16)


def disparity_image(frame: ExportFrame, stamp_ns: int, frame_id: str) -> RosMessage:
    """Give disparity + offset, positive float32 pixels, 0 (below `min_disparity`) where there is no finite depth."""
    geometry, window = frame.geometry, frame.geometry.window
    step = 1.0 / FRACTION
    found = frame.inverse_px
    positive = np.isfinite(found) & (found > 0)
    return RosMessage(
        "stereo_msgs/msg/DisparityImage",
        {
            "header": header(stamp_ns, frame_id),
            "image": image(np.where(positive, found, np.float32(0)), stamp_ns, frame_id),
            "f": geometry.focal_px,
            "t": geometry.baseline_m,
            "valid_window": _region(geometry.width, geometry.height),
            "min_disparity": max(1.0 + window.offset_px, step),
            "max_disparity": window.labels - 2 + window.offset_px,
            "delta_d": step,
        },
    )


def point_cloud2(frame: ExportFrame, stamp_ns: int, frame_id: str) -> RosMessage:
    """Give the points in metres, one row of them, with `rgb` as rviz and PCL read it; black without a picture."""
    cloud = frame.cloud(frame.geometry.metres)
    rows = np.zeros(len(cloud.points), _POINT)
    for axis, name in enumerate("xyz"):
        rows[name] = cloud.points[:, axis]
    if cloud.colours is not None:
        red, green, blue = (cloud.colours[:, channel].astype(np.uint32) for channel in range(3))
        rows["rgb"] = red << 16 | green << 8 | blue
    fields = tuple(
        RosMessage("sensor_msgs/msg/PointField", {"name": name, "offset": 4 * at, "datatype": _FLOAT32, "count": 1})
        for at, name in enumerate(("x", "y", "z", "rgb"))
    )
    return RosMessage(
        "sensor_msgs/msg/PointCloud2",
        {
            "header": header(stamp_ns, frame_id),
            "height": 1,
            "width": len(rows),
            "fields": fields,
            "is_bigendian": False,
            "point_step": _POINT.itemsize,
            "row_step": _POINT.itemsize * len(rows),
            "data": rows.view(np.uint8).reshape(-1),
            "is_dense": True,
        },
    )
