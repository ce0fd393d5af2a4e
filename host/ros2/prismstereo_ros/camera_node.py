"""The node around one camera: what it sends becomes topics, its settings parameters, its calibration a service.

Threads read the camera (frames, zones, raw frames) and publish; ROS's own thread spins for parameters, services and the
report once a second. Nothing is computed for a topic that nobody listens to.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Literal

from prismstereo import StereoCamera
from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import FrameGeometry
from prismstereo.export.live import LiveFrames
from prismstereo.export.ros_diagnostics import diagnostic_array
from prismstereo.export.ros_frame import TOPICS, DepthEncoding, FrameMessages
from prismstereo.export.ros_messages import FrameNames, image, static_transforms
from prismstereo.export.ros_scan import laser_scan
from prismstereo_device.protocol import ReceivedFrame, ReceivedPicture
from prismstereo_device.split import split
from prismstereo_device.wire import Channel
from prismstereo_device.zones import ZoneDistances
from prismstereo_hw.errors import DataError, PrismStereoError
from prismstereo_hw.frame import RawFrame
from prismstereo_ros.camera_info_intake import CameraInfoIntake
from prismstereo_ros.setting_parameters import SettingParameters
from prismstereo_ros.stamps import stamp_ns
from prismstereo_ros.topics import Topics

__all__ = ["CameraNode"]

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")
_REPORT_S = 1.0
_RAW_TOPICS = {side: f"{side}/image_raw" for side in SIDES}
_IMAGE, _SCAN = "sensor_msgs/msg/Image", "sensor_msgs/msg/LaserScan"
_STATIC, _DIAGNOSTICS = "/tf_static", "/diagnostics"


class CameraNode:
    """Serves `camera`, which it does not own, until `close`; `qos` and `interfaces`: rclpy.qos, rcl_interfaces.msg."""

    def __init__(
        self,
        node: Any,
        camera: StereoCamera,
        *,
        qos: Any,
        interfaces: Any,
        names: FrameNames,
        depth: DepthEncoding,
        publish_tf: bool,
    ) -> None:
        self._node, self._camera, self._names = node, camera, names
        self._voice = node.get_logger()
        self._topics = Topics(node, qos)
        self._messages = FrameMessages(names, depth)
        self._publish_tf = publish_tf
        self._geometry: FrameGeometry | None = None
        self._baseline_m = 0.0
        self._zones_at_us: int | None = None
        self._closing = threading.Event()
        self._declare_topics()
        self._parameters = SettingParameters(node, interfaces, camera)
        self._intake = CameraInfoIntake()
        self._serve_calibration()
        self._before = camera.statistics
        node.create_timer(_REPORT_S, self._report)
        self._streams = (camera.stream(Channel.ZONES), camera.stream(Channel.RAW))
        readers: tuple[Callable[[], None], ...] = (self._read_frames, self._read_zones, self._read_raw)
        self._threads = [threading.Thread(target=self._guarded, args=(reader,)) for reader in readers]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Let the threads end; the camera's reading ends with it, so close the camera first."""
        self._closing.set()
        for stream in self._streams:
            stream.close()
        for thread in self._threads:
            thread.join()

    def _declare_topics(self) -> None:
        for topic in TOPICS:
            self._topics.declare(topic.name, topic.kind)
        for name in _RAW_TOPICS.values():
            self._topics.declare(name, _IMAGE)
        self._topics.declare("scan", _SCAN)
        self._topics.declare_kept(_STATIC, "tf2_msgs/msg/TFMessage")
        self._topics.declare_usual(_DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray")

    def _guarded(self, reader: Callable[[], None]) -> None:
        try:
            reader()
        except PrismStereoError as error:
            if not self._closing.is_set():
                self._voice.error(str(error))

    def _read_frames(self) -> None:
        frames = LiveFrames(self._camera, self._frame_ns, self._pictures_late)
        while not self._closing.is_set():
            try:
                for frame in frames:
                    self._publish(frame)
            except DataError as error:  # its calibration was replaced between a frame and the question for it
                self._voice.warning(str(error))
            else:
                return  # the camera said that its stream has ended

    def _pictures_late(self) -> int:
        return 1 if self._topics.wanted("left/image_rect") else 0

    def _publish(self, frame: ExportFrame) -> None:
        self._geometry = frame.geometry
        if self._publish_tf and frame.geometry.baseline_m != self._baseline_m:
            self._baseline_m = frame.geometry.baseline_m
            self._topics.publish(_STATIC, static_transforms(frame.timestamp_ns, self._names, self._baseline_m))
        for topic, message in self._messages.of(frame, frame.timestamp_ns, self._topics.wanted):
            self._topics.publish(topic, message)

    def _read_zones(self) -> None:
        for zones in self._streams[0]:
            assert isinstance(zones, ZoneDistances)
            before, self._zones_at_us = self._zones_at_us, zones.timestamp_us
            if self._geometry is not None and self._topics.wanted("scan"):
                period_s = 0.0 if before is None else max(zones.timestamp_us - before, 0) / 1e6
                at_ns = self._stamp_ns(zones.timestamp_us)
                scan = laser_scan(zones, self._geometry, at_ns, self._names.link, period_s)
                self._topics.publish("scan", scan)

    def _read_raw(self) -> None:
        for picture in self._streams[1]:
            assert isinstance(picture, ReceivedPicture)
            if any(self._topics.wanted(name) for name in _RAW_TOPICS.values()):
                self._publish_raw(picture)

    def _publish_raw(self, picture: ReceivedPicture) -> None:
        """Publish the two views of a raw frame, each upright, as a camera of its own would see it."""
        calibration = self._camera.calibration
        head = picture.head
        try:
            frame = RawFrame(picture.pixels(), head.frame, head.timestamp_us, head.lens_position)
            calibration.require_frame(frame)
        except DataError as error:
            self._voice.warning(f"raw frame {head.frame}: {error}")
            return
        pair = split(frame, calibration.views)
        at_ns = self._stamp_ns(head.timestamp_us)
        for side, pixels in zip(SIDES, (pair.left, pair.right), strict=True):
            self._topics.publish(_RAW_TOPICS[side], image(pixels, at_ns, self._names.left))

    def _frame_ns(self, frame: ReceivedFrame) -> int:
        return self._stamp_ns(frame.timestamp_us)

    def _stamp_ns(self, device_us: int) -> int:
        now_ns = int(self._node.get_clock().now().nanoseconds)
        return stamp_ns(device_us, self._camera.clock, now_ns=now_ns, monotonic_ns=time.monotonic_ns())

    def _report(self) -> None:
        camera, now = self._camera, self._camera.statistics
        at_ns = int(self._node.get_clock().now().nanoseconds)
        hardware = camera.identity.device_id.hex()
        told = diagnostic_array(
            self._names.sensor, hardware, camera.state, now, self._before, stamp_ns=at_ns, period_s=_REPORT_S
        )
        self._before = now
        self._topics.publish(_DIAGNOSTICS, told)

    def _serve_calibration(self) -> None:
        from prismstereo_ros.ros_types import RosTypes

        kind = RosTypes().type_of("sensor_msgs/srv/SetCameraInfo")
        self._node.create_service(kind, "~/left/set_camera_info", self._set_left)
        self._node.create_service(kind, "~/right/set_camera_info", self._set_right)

    def _set_left(self, request: Any, response: Any) -> Any:
        return self._set_camera_info("left", request, response)

    def _set_right(self, request: Any, response: Any) -> Any:
        return self._set_camera_info("right", request, response)

    def _set_camera_info(self, side: Side, request: Any, response: Any) -> Any:
        try:
            content = self._intake.take(side, request.camera_info, self._camera.calibration)
            if content is not None:
                self._camera.write_calibration(content)
        except PrismStereoError as error:
            response.success, response.status_message = False, str(error)
            return response
        response.success = True
        other = "right" if side == "left" else "left"
        waits = f"kept; it is written to the camera once {other}/set_camera_info was called too"
        response.status_message = waits if content is None else "both views are written to the camera"
        return response
