"""A stand-in for a ROS distribution, as strict as rclpy: what it does not know fails, and messages check every value.

Message types come from ROS's own definitions, as `rosbags` carries them; whatever is published is also serialised by it.
"""

from __future__ import annotations

import sys
import threading
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

_PRIMITIVES = {"float32": "float", "float64": "double", "byte": "octet", "bool": "boolean"}
_CODES = {
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "float64": "d",
}
_WHOLE = {name: (0, 2**bits - 1) for bits in (8, 16, 32, 64) for name in (f"uint{bits}",)} | {
    f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)
}
_BASE, _NAME, _ARRAY = 1, 2, 3  # rosbags' node types; 4 is a sequence


class _Message:
    """What all fake messages are; `ros_fields` are (name, node type, detail) as rosbags has them."""

    ros_kind: str
    ros_fields: dict[str, tuple[int, Any]]
    ros_distribution: _Distribution

    def __init__(self, **values: object) -> None:
        for name, node in self.ros_fields.items():
            object.__setattr__(self, name, self.ros_distribution.empty(node))
        for name, value in values.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: object) -> None:
        if name not in self.ros_fields:
            raise AttributeError(f"{self.ros_kind} has no field {name!r}")
        self.ros_distribution.require(f"{self.ros_kind}.{name}", self.ros_fields[name], value)
        object.__setattr__(self, name, value)

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        return {name: _spelled(node) for name, node in cls.ros_fields.items()}


def _spelled(node: tuple[int, Any]) -> str:
    kind, detail = node
    if kind == _BASE:
        return _PRIMITIVES.get(detail[0], str(detail[0]))
    if kind == _NAME:
        return str(detail).replace("/msg/", "/")
    inner = _spelled(detail[0])
    return f"{inner}[{detail[1]}]" if kind == _ARRAY else f"sequence<{inner}>"


class _Distribution:
    """Makes message classes by the names of their types."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self._made: dict[str, type[_Message]] = {}

    def type_of(self, kind: str) -> type[_Message]:
        if kind not in self._made:
            _, fields = self.store.fielddefs[kind]
            content = {
                "ros_kind": kind,
                "ros_fields": {name: (int(n), d) for name, (n, d) in fields},
                "ros_distribution": self,
            }
            self._made[kind] = type(kind.rpartition("/")[2], (_Message,), content)
        return self._made[kind]

    def empty(self, node: tuple[int, Any]) -> object:
        kind, detail = node
        if kind == _NAME:
            return self.type_of(detail)()
        if kind == _ARRAY:
            return np.zeros(detail[1], _CODES[detail[0][1][0]])
        if kind != _BASE:
            return []
        name = detail[0]
        return {"string": "", "bool": False, "byte": b"\0"}.get(name, 0.0 if name.startswith("float") else 0)

    def require(self, where: str, node: tuple[int, Any], value: object) -> None:
        kind, detail = node
        if kind == _BASE:
            _require_base(where, detail[0], value)
        elif kind == _NAME:
            assert isinstance(value, self.type_of(detail)), where
        elif kind == _ARRAY:
            right = np.dtype(_CODES[detail[0][1][0]])
            assert isinstance(value, np.ndarray), where
            assert (value.dtype, value.shape) == (right, (detail[1],)), where
        elif isinstance(value, array):
            assert value.typecode == _CODES[detail[0][1][0]], where
        else:
            assert isinstance(value, list), f"{where}: {type(value)}"
            inner = int(detail[0][0]), detail[0][1]
            for item in value:
                self.require(where, inner, item)

    def serialised(self, message: _Message) -> bytes:
        return bytes(self.store.serialize_cdr(self._plain(message), message.ros_kind))

    def _plain(self, value: Any) -> Any:
        if isinstance(value, _Message):
            fields = {name: self._field(node, getattr(value, name)) for name, node in value.ros_fields.items()}
            return self.store.types[value.ros_kind](**fields)
        return value[0] if isinstance(value, bytes) else value

    def _field(self, node: tuple[int, Any], value: Any) -> Any:
        kind, detail = node
        if kind in (_BASE, _NAME, _ARRAY):
            return self._plain(value)
        inner = int(detail[0][0]), detail[0][1]
        if inner[0] == _BASE and inner[1][0] in _CODES:
            return np.array(value, _CODES[inner[1][0]])
        return [self._plain(item) for item in value]


def _require_base(where: str, name: str, value: object) -> None:
    if name in _WHOLE:
        low, high = _WHOLE[name]
        assert type(value) is int, f"{where}: {value!r}"
        assert low <= value <= high, f"{where}: {value!r}"
    else:
        right = {"string": str, "bool": bool, "byte": bytes}.get(name, float)
        assert isinstance(value, right), f"{where}: {value!r}"
        assert name != "byte" or len(value) == 1, where


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

    def create_publisher(self, kind: type[_Message], topic: str, qos: QoS) -> Any:
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
    distribution: _Distribution = field(default_factory=_Distribution)

    def publisher(self, kind: type[_Message], topic: str, qos: QoS) -> Any:
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
