"""A ROS 2 bag without ROS: rosbag2's folder with MCAP storage, written by the package `rosbags` (extra `ros`)."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from prismstereo.export.extras import extra_module
from prismstereo.export.frames import ExportFrame
from prismstereo.export.ros_frame import DepthEncoding, FrameMessages
from prismstereo.export.ros_messages import FrameNames, Numbers, RosMessage, build, static_transforms
from prismstereo_hw.errors import DataError, UsageError

__all__ = ["BagWriter", "write_bag"]

_VERSION = 9  # of metadata.yaml: Jazzy's; Humble reads it too
_LEAST_NS = 1_000_000_000  # a stamp of 0 means "the latest" to ROS, so a clock that begins there is moved by a second
_STATIC = "/tf_static"


class _BagTypes:
    """The message classes of `rosbags`."""

    def __init__(self, store: Any) -> None:
        self._store = store

    def message(self, kind: str, fields: dict[str, object]) -> object:
        return self._store.types[kind](**fields)

    def numbers(self, values: Numbers) -> object:
        return values

    def octet(self, value: int) -> object:
        return value


class BagWriter:
    """Writes messages into a bag; the folder appears when it is whole. UsageError where there is something already."""

    def __init__(self, out: Path) -> None:
        writing, typesys = extra_module("rosbags.rosbag2", "ros"), extra_module("rosbags.typesys", "ros")
        if out.exists():
            raise UsageError(f"{out} exists already: give the bag a name of its own")
        self._out = out
        self._unfinished = out.parent / f".{out.name}.{secrets.token_hex(6)}"
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._types = _BagTypes(self._store)
        self._connections: dict[str, Any] = {}
        inner = self._unfinished / out.name  # the MCAP file inside has the folder's name
        try:
            self._writer = writing.Writer(inner, version=_VERSION, storage_plugin=writing.StoragePlugin.MCAP)
            self._writer.set_compression(writing.CompressionMode.STORAGE, writing.CompressionFormat.ZSTD)
            self._writer.open()
        except OSError as error:
            raise DataError(f"cannot write {out}: {error.strerror}: give a folder that can be written to") from error

    def write(self, topic: str, message: RosMessage, timestamp_ns: int) -> None:
        """Write a message that was recorded at a time; DataError where the disk does not take it."""
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, message.kind, typestore=self._store, offered_qos_profiles=_qos(topic)
            )
        content = self._store.serialize_cdr(build(message, self._types), message.kind)
        try:
            self._writer.write(self._connections[topic], timestamp_ns, content)
        except OSError as error:
            raise DataError(f"cannot write {self._out}: {error.strerror}: nothing is left of it") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._finish()
            else:
                self._writer.abort()
        finally:
            shutil.rmtree(self._unfinished, ignore_errors=True)

    def _finish(self) -> None:
        try:
            self._writer.close()
            os.rename(self._unfinished / self._out.name, self._out)
        except OSError as error:
            raise DataError(f"cannot write {self._out}: {error.strerror}: nothing is left of it") from error


def _qos(topic: str) -> list[Any]:
    """Say that static transforms wait for late comers, as tf2 asks; the rest is as usual."""
    if topic != _STATIC:
        return []
    ros = extra_module("rosbags.interfaces", "ros")
    never = ros.QosTime(0, 0)
    return [
        ros.Qos(
            history=ros.QosHistory.KEEP_LAST,
            depth=1,
            reliability=ros.QosReliability.RELIABLE,
            durability=ros.QosDurability.TRANSIENT_LOCAL,
            deadline=never,
            lifespan=never,
            liveliness=ros.QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=never,
            avoid_ros_namespace_conventions=False,
        )
    ]


def write_bag(
    out: Path,
    frames: Iterable[ExportFrame],
    *,
    names: FrameNames,
    depth: DepthEncoding = "16UC1",
) -> int:
    """Write frames as a bag: `TOPICS` below `/SENSOR/`, and `/tf_static`; return how many frames it holds.

    UsageError where the package is not installed, `out` exists or the calibration has no millimetres.
    """
    messages = FrameMessages(names, depth)
    count, shift_ns, baseline_m = 0, 0, 0.0
    with BagWriter(out) as bag:
        for count, frame in enumerate(frames, start=1):
            if count == 1 and frame.timestamp_ns < _LEAST_NS:
                shift_ns = _LEAST_NS
            at_ns = frame.timestamp_ns + shift_ns
            if baseline_m != frame.geometry.baseline_m:
                baseline_m = frame.geometry.baseline_m
                bag.write(_STATIC, static_transforms(at_ns, names, baseline_m), at_ns)
            for topic, message in messages.of(frame, at_ns):
                bag.write(f"/{names.sensor}/{topic}", message, at_ns)
        if not count:
            raise DataError(f"there are no frames to write to {out}: see what the source holds")
    return count
