"""One camera under watch: what arrives becomes messages, which are made only if a browser takes them."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from typing import Protocol

from prismstereo.camera_frame import CameraFrame
from prismstereo.driver import PictureChannel, StereoCamera
from prismstereo.inbox import Stream
from prismstereo.viewer.geometry import Geometry
from prismstereo.viewer.message import Kind, LazyMessage
from prismstereo.viewer.pictures import Rectified, frame_message, left_message, raw_message, reasons_message
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.protocol import ReceivedPicture
from prismstereo_device.wire import Channel
from prismstereo_hw.errors import DeviceError, PrismStereoError

__all__ = ["Audience", "Watch"]

logger = logging.getLogger(__name__)

_PICTURES: tuple[PictureChannel, ...] = (Channel.IMG, Channel.RAW, Channel.REASON)
_RATE_S = 3.0
_LEAST_SPAN_S = 0.2
_FEWEST = 3
_AGAIN_S = 2.0  # a calibration that could not be had is asked for again after so long

_Key = tuple[bytes, DisparityWindow]


class Audience(Protocol):
    """Whoever a camera is watched for; called by the watch's threads, quick."""

    def post(self, kind: Kind, message: LazyMessage) -> None:
        """Take the newest message of a kind."""

    def tell(self, kind: str, what: object) -> None:
        """Take a word: the geometry when it changes, a note for people."""


class Watch:
    """Reads a camera in threads of its own and hands on what arrives; owns the camera, and closes it."""

    def __init__(self, camera: StereoCamera, audience: Audience) -> None:
        self.camera = camera
        self._audience = audience
        self._geometry: tuple[_Key, Geometry | None, float] | None = None
        self._rectified: Rectified | None = None
        self._arrivals: deque[float] = deque(maxlen=512)
        self.newest: CameraFrame | None = None
        self.arrived_us = 0
        self._streams = [camera.stream(channel, 1) for channel in _PICTURES]
        self._threads = [threading.Thread(target=self._read_frames, name="prismstereo-view", daemon=True)]
        for stream in self._streams:
            reading = threading.Thread(
                target=self._read_pictures, args=(stream,), name="prismstereo-pictures", daemon=True
            )
            self._threads.append(reading)
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """End it, and the camera's session."""
        self.camera.close()
        for stream in self._streams:
            stream.close()
        for thread in self._threads:
            thread.join()

    @property
    def rate_hz(self) -> float:
        """Frames a second that lately arrived: over three seconds, or between the last two where they come more slowly."""
        now_s, arrivals = time.monotonic(), list(self._arrivals)
        recent = [stamp for stamp in arrivals if now_s - stamp < _RATE_S]
        if len(recent) < _FEWEST:
            recent = arrivals[-2:]
        return (len(recent) - 1) / max(now_s - recent[0], _LEAST_SPAN_S) if len(recent) > 1 else 0.0

    @property
    def geometry(self) -> Geometry | None:
        """The geometry of the newest frame; None where the camera has no calibration that fits."""
        return None if self._geometry is None else self._geometry[1]

    def _read_frames(self) -> None:
        try:
            for frame in self.camera:
                self._arrivals.append(time.monotonic())
                self.arrived_us = time.monotonic_ns() // 1000
                self.newest = frame
                geometry = self._geometry_of(frame)
                self._audience.post(Kind.DISPARITY, frame_message(frame, geometry))
            self._audience.tell("note", "The stream has ended.")
        except DeviceError as error:
            self._audience.tell("note", f"The camera is lost: {error}")

    def _read_pictures(self, stream: Stream[ReceivedPicture]) -> None:
        try:
            for picture in stream:
                self._show(picture)
        except DeviceError:
            return  # the frames' thread says so

    def _show(self, picture: ReceivedPicture) -> None:
        post, channel = self._audience.post, picture.head.kind.channel
        if channel == Channel.IMG:
            post(Kind.LEFT, left_message(picture))
        elif channel == Channel.REASON:
            post(Kind.REASONS, reasons_message(picture))
        else:
            post(Kind.RAW, raw_message(picture))
            geometry = self.geometry
            if geometry is not None:
                if self._rectified is None or self._rectified.geometry is not geometry:
                    self._rectified = Rectified(geometry)
                post(Kind.PAIR, self._rectified.message(picture))

    def _geometry_of(self, frame: CameraFrame) -> Geometry | None:
        """Give the geometry of a frame, made anew where its calibration or its window is another."""
        key, now_s = (frame.calibration_hash, frame.disparity.window), time.monotonic()
        held = self._geometry
        if held is not None and held[0] == key and (held[1] is not None or now_s < held[2]):
            return held[1]
        geometry: Geometry | None = None
        try:
            if any(frame.calibration_hash):
                geometry = Geometry.of(self.camera.calibration, frame.disparity.window)
        except PrismStereoError as error:
            self._audience.tell("note", f"No depth, only disparity: {error}")
        self._geometry = (key, geometry, now_s + _AGAIN_S)
        self._audience.tell("geometry", None if geometry is None else geometry.told())
        return geometry
