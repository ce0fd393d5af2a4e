"""The message classes of a ROS distribution, found by the names of their types."""

from __future__ import annotations

from array import array
from importlib import import_module
from typing import Any

import numpy as np

from prismstereo.export.ros_messages import Numbers

__all__ = ["RosTypes"]


class RosTypes:
    """Makes rclpy's messages; sequences of numbers become arrays at one stroke, not number by number."""

    def type_of(self, kind: str) -> Any:
        """Find the class of `package/msg/Name` or `package/srv/Name`."""
        package, group, name = kind.split("/")
        return getattr(import_module(f"{package}.{group}"), name)

    def message(self, kind: str, fields: dict[str, object]) -> object:
        """Make a message."""
        found = self.type_of(kind)
        types: dict[str, str] = found.get_fields_and_field_types()
        return found(**{name: _fitting(value, types[name]) for name, value in fields.items()})

    def numbers(self, values: Numbers) -> object:
        """Leave numbers as they are: what they must be, the message that holds them knows."""
        return values

    def octet(self, value: int) -> object:
        """Make a `byte`."""
        return bytes([value])


def _fitting(value: object, ros_type: str) -> object:
    """Turn numpy's numbers into what a field of that type takes: fixed arrays are numpy's, sequences Python's."""
    if not isinstance(value, np.ndarray) or ros_type.endswith("]"):
        return value
    return array(value.dtype.char, np.ascontiguousarray(value).tobytes())
