"""A stand-in for a ROS distribution, as strict as rclpy: what it does not know fails, and messages check every value.

Message types come from ROS's own definitions, as `rosbags` carries them; whatever is published is also serialised by it.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from host.fake_ros_messages import Distribution, Message


class Reliability(Enum):
    RELIABLE = 1
    BEST_EFFORT = 2


class Durability(Enum):
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


@dataclass(frozen=True)
class QoS:
    depth: int
    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE


SENSOR_DATA = QoS(5, Reliability.BEST_EFFORT)


class ExternalShutdownException(Exception):
    pass


class _Node:
    def __init__(self, graph: Graph, name: str) -> None:
        self._graph, self._name = graph, name

    def get_name(self) -> str:
        return self._name

    def get_logger(self) -> Any:
        said = self._graph.said
        return SimpleNamespace(error=said.append, warning=said.append, info=said.append)

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self._graph.now_ns))

    def declare_parameter(self, name: str, value: object, descriptor: Any) -> Any:
        assert type(descriptor).__name__ == "ParameterDescriptor"
        assert name not in self._graph.parameters
        assert isinstance(value, bool | int | float | str | list)
        given = self._graph.arguments.get(name, value)
        self._graph.parameters[name] = (given, descriptor)
        return SimpleNamespace(name=name, value=given)

    def add_on_set_parameters_callback(self, callback: Callable[[list[Any]], Any]) -> None:
        self._graph.setting = callback

    def create_publisher(self, kind: type[Message], topic: str, qos: QoS) -> Any:
        assert isinstance(qos, QoS)
        return self._graph.publisher(kind, topic.replace("~", f"/{self._name}"), qos)

    def create_service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
        assert kind.__name__ == "SetCameraInfo"
        self._graph.services[name.replace("~", f"/{self._name}")] = callback

    def create_timer(self, period_s: float, callback: Callable[[], None]) -> None:
        assert period_s > 0
        self._graph.timers.append(callback)

    def destroy_node(self) -> None:
        self._graph.destroyed = True


@dataclass
class Graph:
    """What a test sees of ROS: messages by topic, parameters, services, and who listens (everybody unless told)."""

    arguments: dict[str, object] = field(default_factory=dict)
    deaf: set[str] = field(default_factory=set)
    messages: dict[str, list[Any]] = field(default_factory=dict)
    qos: dict[str, QoS] = field(default_factory=dict)
    parameters: dict[str, tuple[object, Any]] = field(default_factory=dict)
    services: dict[str, Callable[[Any, Any], Any]] = field(default_factory=dict)
    timers: list[Callable[[], None]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    setting: Callable[[list[Any]], Any] | None = None
    spin: Callable[[], None] = lambda: None
    now_ns: int = 1_700_000_000_000_000_000
    destroyed: bool = False
    up: bool = False
    problems: list[BaseException] = field(default_factory=list)
    distribution: Distribution = field(default_factory=Distribution)

    def publisher(self, kind: type[Message], topic: str, qos: QoS) -> Any:
        assert topic not in self.qos
        self.qos[topic] = qos
        heard = self.messages.setdefault(topic, [])

        def publish(message: Any) -> None:
            try:
                assert isinstance(message, kind)
                assert self.distribution.serialised(message)
            except BaseException as error:
                self.problems.append(error)
                raise
            heard.append(message)

        return SimpleNamespace(publish=publish, get_subscription_count=lambda: 0 if topic in self.deaf else 1)

    def wait_for(self, *topics: str, timeout_s: float = 20.0) -> None:
        """Wait until something was heard on each topic."""
        done = threading.Event()
        for _ in range(int(timeout_s / 0.01)):
            if all(self.messages[topic] for topic in topics) or self.problems:
                break
            done.wait(0.01)
        assert not self.problems, self.problems
        assert all(self.messages[topic] for topic in topics), {name: len(m) for name, m in self.messages.items()}

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Let this be the ROS that `import rclpy` finds."""
        modules = {
            "rclpy": {"init": self._init, "create_node": self._node, "spin": self._spin, "try_shutdown": self._down},
            "rclpy.executors": {"ExternalShutdownException": ExternalShutdownException},
            "rclpy.qos": {
                "qos_profile_sensor_data": SENSOR_DATA,
                "QoSProfile": QoS,
                "ReliabilityPolicy": Reliability,
                "DurabilityPolicy": Durability,
            },
            "sensor_msgs.srv": {"SetCameraInfo": type("SetCameraInfo", (), {})},
        }
        for kind in self.distribution.store.fielddefs:
            package, group, name = kind.split("/")
            if group == "msg":
                modules.setdefault(f"{package}.msg", {})[name] = kind
        for name in tuple(modules):
            for part in (name.partition(".")[0], name):
                if part not in sys.modules or part == name:
                    monkeypatch.setitem(sys.modules, part, self._module(part, modules.get(part, {})))

    def _module(self, name: str, content: dict[str, Any]) -> ModuleType:
        module = ModuleType(name)
        if name.endswith(".msg"):
            kinds = dict(content)
            vars(module)["__getattr__"] = lambda wanted: self.distribution.type_of(kinds[wanted])
        else:
            vars(module).update(content)
        module.__path__ = []
        return module

    def _init(self, *, args: list[str] | None = None) -> None:
        assert not self.up
        self.up = True

    def _node(self, name: str) -> _Node:
        assert self.up
        return _Node(self, name)

    def _spin(self, node: _Node) -> None:
        assert isinstance(node, _Node)
        self.spin()

    def _down(self) -> None:
        self.up = False
