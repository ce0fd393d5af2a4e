"""ROS's message classes as rclpy has them, each value checked when it is set; made of the definitions in `rosbags`."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np

__all__ = ["Distribution", "Message"]

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


class Message:
    """What all fake messages are; `ros_fields` are (name, node type, detail) as rosbags has them."""

    ros_kind: str
    ros_fields: dict[str, tuple[int, Any]]
    ros_distribution: Distribution

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


class Distribution:
    """Makes message classes by the names of their types."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self._made: dict[str, type[Message]] = {}

    def type_of(self, kind: str) -> type[Message]:
        if kind not in self._made:
            _, fields = self.store.fielddefs[kind]
            content = {
                "ros_kind": kind,
                "ros_fields": {name: (int(n), d) for name, (n, d) in fields},
                "ros_distribution": self,
            }
            self._made[kind] = type(kind.rpartition("/")[2], (Message,), content)
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

    def serialised(self, message: Message) -> bytes:
        return bytes(self.store.serialize_cdr(self._plain(message), message.ros_kind))

    def _plain(self, value: Any) -> Any:
        if isinstance(value, Message):
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
