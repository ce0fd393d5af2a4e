"""Frames and pictures of a camera as messages for the page."""

from __future__ import annotations

import logging
import threading

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.camera_frame import CameraFrame
from prismstereo.viewer.geometry import Geometry
from prismstereo.viewer.message import Kind, LazyMessage, pack, packed_plane, packed_steps
from prismstereo_calibration.rectification import Rectification
from prismstereo_device.protocol import PictureEncoding, ReceivedPicture
from prismstereo_device.rectify import Rectifier
from prismstereo_device.split import split
from prismstereo_device.wire import WireError
from prismstereo_hw.errors import DataError
from prismstereo_hw.frame import RawFrame

__all__ = ["Rectified", "frame_message", "left_message", "raw_message", "reasons_message"]

logger = logging.getLogger(__name__)

_QUALITY = 85


def frame_message(frame: CameraFrame, geometry: Geometry | None) -> LazyMessage:
    """Make the message of a disparity map; without a geometry it says no depth."""

    def made() -> bytes:
        disparity = frame.disparity
        height, width = disparity.disparity_px.shape
        head: dict[str, object] = {
            "frame": frame.index,
            "stamp_us": frame.timestamp_us,
            "session": frame.session,
            "partial": frame.partial,
            "width": width,
            "height": height,
            "labels": disparity.window.labels,
            "offset_px": disparity.window.offset_px,
            "scale_px": disparity.window.scale_px,
            "unit": "mm" if geometry is None else geometry.made.unit,
            "projection": None if geometry is None else geometry.projection(width, height),
        }
        return pack(Kind.DISPARITY, head, packed_steps(disparity.fixed_point()))

    return LazyMessage(made)


def left_message(picture: ReceivedPicture) -> LazyMessage:
    """Make the message of a preview: the camera's own JPEG."""
    return LazyMessage(lambda: _picture(Kind.LEFT, picture, picture.data))


def raw_message(picture: ReceivedPicture) -> LazyMessage:
    """Make the message of a raw frame, as JPEG."""

    def made() -> bytes:
        if picture.head.encoding is PictureEncoding.JPEG:
            return _picture(Kind.RAW, picture, picture.data)
        pixels = _decoded(picture)
        return b"" if pixels is None else _picture(Kind.RAW, picture, _jpeg(pixels))

    return LazyMessage(made)


def reasons_message(picture: ReceivedPicture) -> LazyMessage:
    """Make the message of a plane of reasons."""

    def made() -> bytes:
        pixels = _decoded(picture)
        return b"" if pixels is None else pack(Kind.REASONS, _head(picture), packed_plane(pixels))

    return LazyMessage(made)


class Rectified:
    """Makes rectified pairs of raw frames here, with the camera's calibration, whatever the camera itself makes of them."""

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self._rectifier: Rectifier[Rectification] | None = None
        self._making = threading.Lock()

    def message(self, picture: ReceivedPicture) -> LazyMessage:
        """Make the message of both rectified views side by side, left one left; the page draws the epipolar lines."""
        return LazyMessage(lambda: self._made(picture))

    def _made(self, picture: ReceivedPicture) -> bytes:
        pixels = _decoded(picture)
        if pixels is None:
            return b""
        try:
            frame = RawFrame(pixels, picture.head.frame, picture.head.timestamp_us, picture.head.lens_position)
            self.geometry.calibration.require_frame(frame)
            with self._making:
                self._rectifier = self._rectifier or Rectifier(self.geometry.made)
            pair = self._rectifier.rectify(split(frame, self.geometry.calibration.views))
        except DataError as error:
            logger.warning("a raw frame could not be rectified: %s", error)
            return b""
        both = np.hstack([pair.left, pair.right])
        head = _head(picture) | {"width": both.shape[1], "height": both.shape[0]}
        return pack(Kind.PAIR, head, _jpeg(both))


def _head(picture: ReceivedPicture) -> dict[str, object]:
    head = picture.head
    return {
        "frame": head.frame,
        "stamp_us": head.timestamp_us,
        "width": head.width,
        "height": head.height,
        "crop": head.crop,
        "step": head.step,
    }


def _picture(kind: Kind, picture: ReceivedPicture, data: bytes) -> bytes:
    return pack(kind, _head(picture), data)


def _decoded(picture: ReceivedPicture) -> NDArray[np.uint8] | None:
    try:
        return picture.pixels()
    except WireError as error:
        logger.warning("a picture was not shown: %s", error)
        return None


def _jpeg(pixels: NDArray[np.uint8]) -> bytes:
    done, content = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    assert done
    return content.tobytes()
