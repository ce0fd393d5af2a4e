"""A Video4Linux device asked directly: its modes and its controls, which OpenCV does not list.

The node is opened a second time beside OpenCV's stream; the kernel allows that for everything but the frames themselves.
"""

from __future__ import annotations

import ctypes
import errno
import os
from collections.abc import Callable, Iterator
from enum import IntEnum
from pathlib import Path

from prismstereo_device.sensors import v4l2_layout as layout
from prismstereo_device.sensors.base import Limit, SensorMode
from prismstereo_hw.errors import DeviceError, UsageError

__all__ = ["CameraControl", "Ioctl", "VideoNode"]

Ioctl = Callable[[int, int, ctypes.Structure], object]

_CAPTURE, _CAPTURE_PLANES, _OWN_CAPABILITIES = 0x1, 0x1000, 0x80000000
_ONE_PLANE, _MANY_PLANES = 1, 9  # buffer types
_DISCRETE = 1
_DISABLED, _READ_ONLY = 0x1, 0x4
_MOST_ENTRIES = 256  # of one list: a driver that never says "no more" is not listened to for ever
_GONE = (errno.ENODEV, errno.ENXIO)


class CameraControl(IntEnum):
    """The controls that matter here, by the kernel's numbers."""

    AUTO_GAIN = 0x00980912
    GAIN = 0x00980913
    EXPOSURE_AUTO = 0x009A0901
    EXPOSURE_ABSOLUTE = 0x009A0902  # in units of 100 microseconds
    EXPOSURE_AUTO_PRIORITY = 0x009A0903  # 1: the camera may slow down in the dark
    FOCUS_ABSOLUTE = 0x009A090A
    FOCUS_AUTO = 0x009A090C


class VideoNode:
    """An open video device. `DeviceError` when it went away, `UsageError` where its driver refuses a value."""

    def __init__(self, descriptor: int, path: str, ioctl: Ioctl | None = None) -> None:
        self.path = path
        self._descriptor = descriptor
        if ioctl is None:
            from fcntl import ioctl as of_the_kernel

            ioctl = of_the_kernel
        self._ioctl = ioctl
        capability = layout.Capability()
        try:
            self._ioctl(descriptor, layout.QUERY_CAPABILITY, capability)
        except OSError as error:
            raise DeviceError(f"{path} is no camera ({error.strerror}): give a video device") from error
        can = capability.device_caps if capability.capabilities & _OWN_CAPABILITIES else capability.capabilities
        if not can & (_CAPTURE | _CAPTURE_PLANES):
            raise DeviceError(f"{path} gives no frames: a camera often has several nodes, give its first one")
        self._buffer_type = _ONE_PLANE if can & _CAPTURE else _MANY_PLANES
        self.card = bytes(capability.card).split(b"\0")[0].decode("utf-8", "replace")

    @classmethod
    def open(cls, path: str) -> VideoNode:
        """Open a node by path; `DeviceError` says why not."""
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise DeviceError(f"cannot open the camera {path} ({error.strerror}): {_mend(error.errno)}") from error
        try:
            return cls(descriptor, path)
        except BaseException:
            os.close(descriptor)
            raise

    def close(self) -> None:
        """Close the node; once is enough."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def modes(self) -> tuple[SensorMode, ...]:
        """Return every way to read the camera; of a size that may be anything in a range, its least and its most."""
        return tuple(
            SensorMode(width, height, _name(pixel_format), rate_hz)
            for pixel_format in self._pixel_formats()
            for width, height in self._sizes(pixel_format)
            for rate_hz in self._rates_hz(pixel_format, width, height)
        )

    def limit(self, control: CameraControl) -> Limit | None:
        """Return how far a control goes; None where the camera has none, or none that can be set."""
        query = layout.ControlQuery(id=control)
        if not self._answered(layout.QUERY_CONTROL, query) or query.flags & (_DISABLED | _READ_ONLY):
            return None
        return Limit(query.minimum, query.maximum)

    def get(self, control: CameraControl) -> int:
        """Return a control's value."""
        asked = layout.Control(id=control)
        self._require(layout.GET_CONTROL, asked, f"does not tell {control.name}")
        return int(asked.value)

    def set(self, control: CameraControl, value: int) -> int:
        """Set a control and return what the driver made of it."""
        self._require(layout.SET_CONTROL, layout.Control(id=control, value=value), f"refuses {control.name} {value}")
        return self.get(control)

    def _pixel_formats(self) -> Iterator[int]:
        for index in range(_MOST_ENTRIES):
            query = layout.FormatQuery(index=index, type=self._buffer_type)
            if not self._answered(layout.ENUM_FORMATS, query):
                return
            yield int(query.pixelformat)

    def _sizes(self, pixel_format: int) -> Iterator[tuple[int, int]]:
        for index in range(_MOST_ENTRIES):
            query = layout.SizeQuery(index=index, pixel_format=pixel_format)
            if not self._answered(layout.ENUM_SIZES, query):
                return
            if query.type != _DISCRETE:
                yield query.numbers[0], query.numbers[3]
                yield query.numbers[1], query.numbers[4]
                return
            yield query.numbers[0], query.numbers[1]

    def _rates_hz(self, pixel_format: int, width: int, height: int) -> Iterator[float]:
        for index in range(_MOST_ENTRIES):
            query = layout.IntervalQuery(index=index, pixel_format=pixel_format, width=width, height=height)
            if not self._answered(layout.ENUM_INTERVALS, query):
                if index == 0:
                    yield 0.0  # a driver need not tell
                return
            yield query.numbers[1] / query.numbers[0] if query.numbers[0] else 0.0
            if query.type != _DISCRETE:
                return

    def _answered(self, request: int, asked: ctypes.Structure) -> bool:
        """Ask, and tell whether there was an answer; `DeviceError` when nobody is there any more."""
        try:
            self._ioctl(self._descriptor, request, asked)
        except OSError as error:
            if error.errno in _GONE:
                raise DeviceError(f"the camera {self.path} went away ({error.strerror}): check its cable") from error
            return False
        return True

    def _require(self, request: int, asked: ctypes.Structure, complaint: str) -> None:
        if not self._answered(request, asked):
            raise UsageError(f"the camera {self.path} {complaint}: leave that to the camera, or give another value")


def _name(pixel_format: int) -> str:
    """Return the four letters of a pixel format, without the blanks some end in."""
    return pixel_format.to_bytes(4, "little").decode("ascii", "replace").rstrip(" \0")


def _mend(reason: int | None) -> str:
    if reason == errno.EACCES:
        return "the user who runs this must be in the group video"
    if reason == errno.EBUSY:
        return "another program has it, end that one"
    there = sorted(str(path) for path in Path("/dev").glob("video*"))
    return f"give one of {', '.join(there)}" if there else "no camera is plugged in"
