"""A video file as raw frames, each with the time that its container gives it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from prismstereo_device.sensors.base import SensorMode
from prismstereo_hw.errors import ImageError
from prismstereo_hw.frame import RawFrame

__all__ = ["VIDEO_SUFFIXES", "VideoFile"]

VIDEO_SUFFIXES = {
    ".avi",
    ".h264",
    ".m2ts",
    ".m4v",
    ".mjpeg",
    ".mjpg",
    ".mkv",
    ".mov",
    ".mp4",
    ".mpg",
    ".mts",
    ".ts",
    ".webm",
}
_MOST_PIXELS = 64 * 1024 * 1024
_ASSUMED_RATE_HZ = 30.0
_MOST_RATE_HZ = 1000.0


class VideoFile:
    """A video file that can be read from the front any number of times; `ImageError` for one that cannot be opened.

    Frames come as they are stored: a flag that asks a player to turn them is not obeyed, as the rig's views stand the way
    the sensor has them. Without a time in the container, the frame rate counts.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        capture = self._opened()
        width, height = (int(capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        letters = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        capture.release()
        if not 0 < width * height <= _MOST_PIXELS:
            raise ImageError(f"{path} claims frames of {width}x{height} pixels: at most {_MOST_PIXELS} are read")
        known_hz = rate_hz if 0 < rate_hz <= _MOST_RATE_HZ else 0.0
        coding = letters.to_bytes(4, "little").decode("ascii", "replace").rstrip(" \0")
        self.mode = SensorMode(width, height, coding, known_hz)

    def frames(self) -> Iterator[RawFrame]:
        """Read the frames one after the other; `ImageError` for a file without any."""
        capture, stamp_us, index = self._opened(), 0.0, -1
        period_us = 1e6 / (self.mode.rate_hz or _ASSUMED_RATE_HZ)
        try:
            while capture.grab():
                found, pixels = capture.retrieve()
                if not found:
                    break
                index += 1
                told_us = capture.get(cv2.CAP_PROP_POS_MSEC) * 1000
                stamp_us = told_us if index == 0 or told_us > stamp_us else stamp_us + period_us
                yield RawFrame(np.asarray(pixels).astype(np.uint8, copy=False), index, round(stamp_us))
        finally:
            capture.release()
        if index < 0:
            raise ImageError(f"{self.path} holds no frame that can be read: copy it again")

    def _opened(self) -> cv2.VideoCapture:
        capture = cv2.VideoCapture(os.fspath(self.path), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            capture.release()
            raise ImageError(
                f"{self.path} is no video that can be read: it is cut off, or in a coding that FFmpeg lacks"
            )
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        return capture
