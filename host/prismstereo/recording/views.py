"""Pictures for other people's tools: preview, depth and camera as Foxglove's schemas have them, a few a second.

They are made of the very packets that are recorded, so that the device sends nothing twice; only those frames are decoded that
will be shown. Depth is a 16-bit picture in millimetres, 0 where nothing was matched.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from prismstereo.recording.container import TopicKind
from prismstereo.recording.stored_packet import StoredPacket
from prismstereo_device.protocol import (
    FrameAssembler,
    PictureAssembler,
    PictureEncoding,
    ReceivedFrame,
    calibration_hash,
)
from prismstereo_device.wire import FIRST, Channel
from prismstereo_hw.errors import PrismStereoError

if TYPE_CHECKING:
    from prismstereo_calibration.rectification import Rectification

__all__ = ["View", "Views", "view_kinds"]

logger = logging.getLogger(__name__)

FRAME_ID = "prismstereo_left_optical_frame"
DEPTH, PREVIEW, CAMERA = "/prismstereo/depth", "/prismstereo/left/image_rect", "/prismstereo/left/camera_info"
_FARTHEST_MM = 65535
_SAME_PX = 1e-3


@dataclass(frozen=True, slots=True)
class View:
    """A message for a topic."""

    topic: str
    data: bytes


def view_kinds() -> dict[str, TopicKind]:
    """Name the topics of views, and describe what they carry."""
    return {
        DEPTH: _kind("RawImage", compressed=True),
        PREVIEW: _kind("CompressedImage", compressed=False),
        CAMERA: _kind("CameraCalibration", compressed=True),
    }


class Views:
    """Makes at most `rate_hz` of each view out of the packets that pass; for one thread."""

    def __init__(self, rate_hz: float) -> None:
        self._period_us = 1e6 / rate_hz
        self._due_us = {Channel.DISP: 0.0, Channel.IMG: 0.0}
        self._wanted: dict[Channel, int | None] = {Channel.DISP: None, Channel.IMG: None}
        self._frames, self._pictures = FrameAssembler(), PictureAssembler()
        self._session = 0
        self._calibrated: _Calibrated | None = None
        self._told: tuple[bytes, tuple[int, ...]] | None = None

    def calibrate(self, content: bytes) -> None:
        """Take the flash bytes of the calibration that frames are made with from now on."""
        self._calibrated = _Calibrated(content)

    def take(self, stored: StoredPacket, stamp_ns: Callable[[int], int]) -> list[View]:
        """Take a packet and give the views that it completes; `stamp_ns` takes a device stamp to the wall clock."""
        if stored.session != self._session:
            self._session = stored.session
            self._frames, self._pictures = FrameAssembler(), PictureAssembler()
            self._wanted = dict.fromkeys(self._wanted)
        packet = stored.packet
        if packet.channel not in self._due_us:
            return []
        channel = Channel(packet.channel)
        if packet.flags & FIRST and stored.host_us >= self._due_us[channel]:
            self._wanted[channel] = packet.msg
            self._due_us[channel] = stored.host_us + self._period_us
        if packet.msg != self._wanted[channel]:
            return []
        if channel is Channel.IMG:
            return [
                _preview(one.data, stamp_ns(one.head.timestamp_us))
                for one in self._pictures.feed(packet)
                if one.head.encoding is PictureEncoding.JPEG
            ]
        return [view for frame in self._frames.feed(packet) for view in self._of(frame, stamp_ns(frame.timestamp_us))]

    def _of(self, frame: ReceivedFrame, stamp_ns: int) -> list[View]:
        calibrated = self._calibrated
        if calibrated is not None and not calibrated.hash.startswith(frame.calibration_hash):
            calibrated = None
        window = frame.disparity.window
        if window.scale_px <= 0 or (calibrated is not None and calibrated.unit != "mm"):
            return []
        if calibrated is None or calibrated.rectification is None:
            return [_depth(frame, stamp_ns)]
        rectified = calibrated.rectification
        shape = frame.disparity.disparity_px.shape
        own = rectified.window
        if shape == (rectified.height, rectified.width) and abs(own.offset_px - window.offset_px) < _SAME_PX:
            frame = replace(frame, disparity=replace(frame.disparity, window=replace(window, glass=own.glass)))
        views = [_depth(frame, stamp_ns)]
        if self._told != (calibrated.hash, shape):
            self._told = (calibrated.hash, shape)
            views.insert(0, _camera(rectified, shape, stamp_ns))
        return views


class _Calibrated:
    """A calibration and, once somebody asks, its rectification; None where the bytes are not those of a calibration."""

    def __init__(self, content: bytes) -> None:
        self.hash = calibration_hash(content)
        self._content = content

    @cached_property
    def rectification(self) -> Rectification | None:
        from prismstereo_calibration import flash
        from prismstereo_calibration.rectification import rectification

        try:
            return rectification(flash.unpack(self._content))
        except PrismStereoError as error:
            logger.warning("no camera is written beside the pictures: %s", error)
            return None

    @property
    def unit(self) -> str:
        return "mm" if self.rectification is None else self.rectification.unit


def _depth(frame: ReceivedFrame, stamp_ns: int) -> View:
    depth_mm = np.nan_to_num(frame.disparity.depth(), nan=0.0, posinf=0.0, neginf=0.0)
    steps = np.where((depth_mm > 0) & (depth_mm < _FARTHEST_MM), np.rint(depth_mm), 0).astype("<u2")
    height, width = steps.shape
    message = _schema("RawImage").RawImage(
        frame_id=FRAME_ID, width=width, height=height, encoding="16UC1", step=2 * width, data=steps.tobytes()
    )
    return _view(DEPTH, message, stamp_ns)


def _preview(jpeg: bytes, stamp_ns: int) -> View:
    message = _schema("CompressedImage").CompressedImage(frame_id=FRAME_ID, data=jpeg, format="jpeg")
    return _view(PREVIEW, message, stamp_ns)


def _camera(rectified: Rectification, shape: tuple[int, ...], stamp_ns: int) -> View:
    height, width = shape
    scale = width / rectified.width
    f = rectified.focal_px * scale
    cx, cy = (scale * (at + 0.5) - 0.5 for at in (rectified.left.cx_px, rectified.cy_px))
    message = _schema("CameraCalibration").CameraCalibration(
        frame_id=FRAME_ID,
        width=width,
        height=height,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=[f, 0, cx, 0, f, cy, 0, 0, 1],
        R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
        P=[f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1, 0],
    )
    return _view(CAMERA, message, stamp_ns)


def _view(topic: str, message: Any, stamp_ns: int) -> View:
    message.timestamp.FromNanoseconds(max(0, stamp_ns))
    data: bytes = message.SerializeToString()
    return View(topic, data)


def _schema(name: str) -> ModuleType:
    from importlib import import_module

    return import_module(f"foxglove_schemas_protobuf.{name}_pb2")


def _kind(name: str, *, compressed: bool) -> TopicKind:
    from mcap_protobuf.schema import build_file_descriptor_set

    described = build_file_descriptor_set(getattr(_schema(name), name))
    return TopicKind("protobuf", f"foxglove.{name}", "protobuf", described.SerializeToString(), compressed)
