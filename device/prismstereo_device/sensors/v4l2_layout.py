"""The kernel's Video4Linux structures that are asked for here, byte for byte (linux/videodev2.h), and their requests.

They hold neither pointers nor longs, so they lie the same on 32 and 64 bits.
"""

from __future__ import annotations

import ctypes
from typing import ClassVar

__all__ = [
    "ENUM_FORMATS",
    "ENUM_INTERVALS",
    "ENUM_SIZES",
    "GET_CONTROL",
    "QUERY_CAPABILITY",
    "QUERY_CONTROL",
    "SET_CONTROL",
    "Capability",
    "Control",
    "ControlQuery",
    "FormatQuery",
    "IntervalQuery",
    "SizeQuery",
]

_U8, _U32, _S32 = ctypes.c_uint8, ctypes.c_uint32, ctypes.c_int32
_READ, _BOTH = 2, 3


class Capability(ctypes.Structure):
    """struct v4l2_capability: the driver, the camera's name, what it can do."""

    _fields_: ClassVar = [
        ("driver", _U8 * 16),
        ("card", _U8 * 32),
        ("bus_info", _U8 * 32),
        ("version", _U32),
        ("capabilities", _U32),
        ("device_caps", _U32),
        ("reserved", _U32 * 3),
    ]


class FormatQuery(ctypes.Structure):
    """struct v4l2_fmtdesc: the index-th pixel format."""

    _fields_: ClassVar = [
        ("index", _U32),
        ("type", _U32),
        ("flags", _U32),
        ("description", _U8 * 32),
        ("pixelformat", _U32),
        ("mbus_code", _U32),
        ("reserved", _U32 * 3),
    ]


class SizeQuery(ctypes.Structure):
    """struct v4l2_frmsizeenum: the index-th frame size.

    The numbers are width and height of one size, or least, most and step of the width and then of the height.
    """

    _fields_: ClassVar = [
        ("index", _U32),
        ("pixel_format", _U32),
        ("type", _U32),
        ("numbers", _U32 * 6),
        ("reserved", _U32 * 2),
    ]


class IntervalQuery(ctypes.Structure):
    """struct v4l2_frmivalenum: the index-th time from frame to frame.

    The numbers are numerator and denominator, in seconds, of one time, or of the least, the most and the step.
    """

    _fields_: ClassVar = [
        ("index", _U32),
        ("pixel_format", _U32),
        ("width", _U32),
        ("height", _U32),
        ("type", _U32),
        ("numbers", _U32 * 6),
        ("reserved", _U32 * 2),
    ]


class ControlQuery(ctypes.Structure):
    """struct v4l2_queryctrl: how far a control goes."""

    _fields_: ClassVar = [
        ("id", _U32),
        ("type", _U32),
        ("name", _U8 * 32),
        ("minimum", _S32),
        ("maximum", _S32),
        ("step", _S32),
        ("default_value", _S32),
        ("flags", _U32),
        ("reserved", _U32 * 2),
    ]


class Control(ctypes.Structure):
    """struct v4l2_control: one control's value."""

    _fields_: ClassVar = [("id", _U32), ("value", _S32)]


def _request(direction: int, number: int, layout: type[ctypes.Structure]) -> int:
    """Build a request's number as the kernel's _IOC does for the letter V."""
    return direction << 30 | ctypes.sizeof(layout) << 16 | ord("V") << 8 | number


QUERY_CAPABILITY = _request(_READ, 0, Capability)
ENUM_FORMATS = _request(_BOTH, 2, FormatQuery)
ENUM_SIZES = _request(_BOTH, 74, SizeQuery)
ENUM_INTERVALS = _request(_BOTH, 75, IntervalQuery)
QUERY_CONTROL = _request(_BOTH, 36, ControlQuery)
GET_CONTROL = _request(_BOTH, 27, Control)
SET_CONTROL = _request(_BOTH, 28, Control)
