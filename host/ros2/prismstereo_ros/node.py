"""`ros2 run prismstereo_ros node`: the only place that imports rclpy, and only when it is run."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, cast

from prismstereo.export.ros_frame import DepthEncoding
from prismstereo.export.ros_messages import FrameNames
from prismstereo.opening import open_camera
from prismstereo_hw.errors import PrismStereoError
from prismstereo_ros.camera_node import CameraNode

__all__ = ["REFUSAL", "main"]

REFUSAL = (
    "error: this node needs ROS 2, and none is in this shell ({reason}): source your ROS 2 distribution, for example "
    "`source /opt/ros/jazzy/setup.bash`, with the Python that it was built for; without ROS, `prismstereo export --to ros2` "
    "writes bags"
)
_DEPTHS = ("16UC1", "32FC1")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted or the camera's stream ends; return an exit code."""
    try:
        rclpy = import_module("rclpy")
        executors, qos = import_module("rclpy.executors"), import_module("rclpy.qos")
        interfaces = import_module("rcl_interfaces.msg")
    except ImportError as error:
        sys.stderr.write(REFUSAL.format(reason=error) + "\n")
        return 2
    rclpy.init(args=None if arguments is None else list(arguments))
    node = rclpy.create_node("prismstereo")
    try:
        return _serve(rclpy, node, qos, interfaces)
    except (KeyboardInterrupt, executors.ExternalShutdownException):
        return 0
    except PrismStereoError as error:
        node.get_logger().error(str(error))
        return error.exit_code
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _serve(rclpy: Any, node: Any, qos: Any, interfaces: Any) -> int:
    port = _fixed(node, interfaces, "port", "", "what prismstereo.open takes; empty: the one sensor that is plugged in")
    depth = _fixed(node, interfaces, "depth_encoding", "16UC1", "of ~/depth: 16UC1 in mm, or 32FC1 in metres")
    publish_tf = _fixed(
        node,
        interfaces,
        "publish_tf",
        value=True,
        description="whether to publish /tf_static; not beside a URDF that does",
    )
    if depth not in _DEPTHS:
        node.get_logger().error(f"depth_encoding {depth!r}: give {' or '.join(_DEPTHS)}")
        return 2
    with open_camera(port or None) as camera:
        serving = CameraNode(
            node,
            camera,
            qos=qos,
            interfaces=interfaces,
            names=FrameNames(node.get_name()),
            depth=cast("DepthEncoding", depth),
            publish_tf=bool(publish_tf),
        )
        try:
            rclpy.spin(node)
        finally:
            camera.close()
            serving.close()
    return 0


def _fixed(node: Any, interfaces: Any, name: str, value: object, description: str) -> Any:
    """Declare a parameter that is read once, at the start."""
    descriptor = interfaces.ParameterDescriptor(name=name, description=description, read_only=True)
    return node.declare_parameter(name, value, descriptor).value
