"""Publishers by topic, made when they are declared, and asked whether anybody listens before anything is computed for them."""

from __future__ import annotations

from typing import Any

from prismstereo.export.ros_messages import RosMessage, build
from prismstereo_ros.ros_types import RosTypes

__all__ = ["Topics"]


class Topics:
    """The topics of one node; those of the sensor are its private ones (`~/depth`), so that bag and node name them alike."""

    def __init__(self, node: Any, qos: Any) -> None:
        """Take a node and the module `rclpy.qos`."""
        self._node = node
        self._types = RosTypes()
        self._publishers: dict[str, Any] = {}
        self._stream = qos.qos_profile_sensor_data
        self._kept = qos.QoSProfile(
            depth=1, reliability=qos.ReliabilityPolicy.RELIABLE, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL
        )
        self._usual = qos.QoSProfile(depth=10)

    def declare(self, name: str, kind: str) -> None:
        """Declare a topic of pictures and the like, whose newest counts."""
        self._add(name, f"~/{name}", kind, self._stream)

    def declare_kept(self, name: str, kind: str) -> None:
        """Declare a topic for all of the graph whose last message waits for late comers."""
        self._add(name, name, kind, self._kept)

    def declare_usual(self, name: str, kind: str) -> None:
        """Declare a topic for all of the graph of which nothing is to get lost."""
        self._add(name, name, kind, self._usual)

    def wanted(self, name: str) -> bool:
        """Tell whether anybody listens."""
        return bool(self._publishers[name].get_subscription_count())

    def publish(self, name: str, message: RosMessage) -> None:
        """Publish a message."""
        self._publishers[name].publish(build(message, self._types))

    def _add(self, name: str, topic: str, kind: str, profile: Any) -> None:
        self._publishers[name] = self._node.create_publisher(self._types.type_of(kind), topic, profile)
