"""What ROS is told of a frame, as plain fields: the one place that knows, for the bag on the desk and for the live node.

A message is its type's name and its fields; `build` makes it in whatever classes somebody has (those of `rosbags`, or of
a ROS distribution). Lengths are METRES, frames those of REP 103: `*_link` x forward, y left, z up, `*_optical_frame` x
right, y down, z forward. Depth is counted from the left optical frame, and so both camera_infos are given in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "FrameNames",
    "Maker",
    "Octet",
    "RosMessage",
    "RosValue",
    "build",
    "header",
    "image",
    "stamp",
    "static_transforms",
    "transform",
]

_NS_PER_S = 1_000_000_000
_OPTICAL_IN_BODY = (-0.5, 0.5, -0.5, 0.5)  # x, y, z, w: the optical frame's axes in a body frame (REP 103)
_ENCODINGS = {
    (np.dtype(np.uint8), 2): "mono8",
    (np.dtype(np.uint8), 3): "bgr8",
    (np.dtype(np.uint16), 2): "16UC1",
    (np.dtype(np.float32), 2): "32FC1",
}


@dataclass(frozen=True, slots=True)
class Octet:
    """A ROS `byte`, which languages disagree about."""

    value: int


@dataclass(frozen=True, slots=True)
class RosMessage:
    """A message: `kind` is its type's name, `fields` are all that differ from the type's defaults, and more."""

    kind: str
    fields: Mapping[str, RosValue]


Numbers = NDArray[np.uint8] | NDArray[np.float32] | NDArray[np.float64]
RosValue = bool | int | float | str | Octet | Numbers | RosMessage | tuple[RosMessage, ...]


class Maker(Protocol):
    """Somebody's message classes."""

    def message(self, kind: str, fields: dict[str, object]) -> object:
        """Make a message of a type whose fields are made already."""
        ...

    def numbers(self, values: Numbers) -> object:
        """Make a sequence or an array of numbers."""
        ...

    def octet(self, value: int) -> object:
        """Make a `byte`."""
        ...


def build(message: RosMessage, maker: Maker) -> object:
    """Make a message, and what it holds, in somebody's classes."""
    return maker.message(message.kind, {name: _built(value, maker) for name, value in message.fields.items()})


def _built(value: RosValue, maker: Maker) -> object:
    match value:
        case RosMessage():
            return build(value, maker)
        case Octet():
            return maker.octet(value.value)
        case np.ndarray():
            return maker.numbers(value)
        case tuple():
            return [build(item, maker) for item in value]
    return value


@dataclass(frozen=True, slots=True)
class FrameNames:
    """The frames of one sensor: its name before `_link`, `_left_optical_frame`, `_right_optical_frame`, `_mount`.

    `_link` is the body frame that stands in the left virtual camera, from which all distances are counted.
    """

    sensor: str = "prismstereo"

    @property
    def link(self) -> str:
        """The body frame."""
        return f"{self.sensor}_link"

    @property
    def left(self) -> str:
        """The left rectified optical frame."""
        return f"{self.sensor}_left_optical_frame"

    @property
    def right(self) -> str:
        """The right rectified optical frame."""
        return f"{self.sensor}_right_optical_frame"

    @property
    def mount(self) -> str:
        """The body frame that stands in the real lens' entrance pupil."""
        return f"{self.sensor}_mount"


def stamp(timestamp_ns: int) -> RosMessage:
    """Give a time in seconds and nanoseconds."""
    seconds, rest = divmod(timestamp_ns, _NS_PER_S)
    return RosMessage("builtin_interfaces/msg/Time", {"sec": seconds, "nanosec": rest})


def header(timestamp_ns: int, frame: str) -> RosMessage:
    """Give when and in which frame."""
    return RosMessage("std_msgs/msg/Header", {"stamp": stamp(timestamp_ns), "frame_id": frame})


def image(
    pixels: NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32], timestamp_ns: int, frame: str
) -> RosMessage:
    """Give a picture: grey or BGR of 8 bits, 16 bits as 16UC1, float32 as 32FC1."""
    rows = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
    return RosMessage(
        "sensor_msgs/msg/Image",
        {
            "header": header(timestamp_ns, frame),
            "height": pixels.shape[0],
            "width": pixels.shape[1],
            "encoding": _ENCODINGS[pixels.dtype, pixels.ndim],
            "is_bigendian": 0,
            "step": rows.strides[0],
            "data": rows.view(np.uint8).reshape(-1),
        },
    )


def transform(
    timestamp_ns: int,
    parent: str,
    child: str,
    at_m: tuple[float, float, float],
    turned: tuple[float, float, float, float],
) -> RosMessage:
    """Give where a frame stands in another: its origin there, and its axes there as a quaternion x, y, z, w."""
    where = RosMessage("geometry_msgs/msg/Vector3", dict(zip("xyz", at_m, strict=True)))
    how = RosMessage("geometry_msgs/msg/Quaternion", dict(zip("xyzw", turned, strict=True)))
    return RosMessage(
        "geometry_msgs/msg/TransformStamped",
        {
            "header": header(timestamp_ns, parent),
            "child_frame_id": child,
            "transform": RosMessage("geometry_msgs/msg/Transform", {"translation": where, "rotation": how}),
        },
    )


def static_transforms(timestamp_ns: int, names: FrameNames, baseline_m: float) -> RosMessage:
    """Give where the two optical frames stand: the left one in the body frame, the right one a baseline to its right."""
    left = transform(timestamp_ns, names.link, names.left, (0.0, 0.0, 0.0), _OPTICAL_IN_BODY)
    right = transform(timestamp_ns, names.link, names.right, (0.0, -baseline_m, 0.0), _OPTICAL_IN_BODY)
    return RosMessage("tf2_msgs/msg/TFMessage", {"transforms": (left, right)})
