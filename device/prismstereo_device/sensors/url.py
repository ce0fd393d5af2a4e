"""Network cameras: RTSP and MJPEG over HTTP, through the FFmpeg inside OpenCV.

Stamps are this program's clock when a frame was handed over: encoder, network and buffers are in them, often 0.1 to 1 s.
Addresses hold passwords, in the user part, the path or the query. So complaints and logs name the host only.
"""

from __future__ import annotations

from urllib.parse import urlsplit

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from prismstereo_device.sensors.base import StampQuality
from prismstereo_device.sensors.capture import Capture
from prismstereo_device.sensors.captured import CapturedSensor
from prismstereo_device.sensors.options import Options
from prismstereo_hw.errors import DeviceError, ImageError, UsageError

__all__ = ["UrlSensor"]

_SCHEMES = ("rtsp", "rtsps", "http", "https")
_OPTIONS = ("colour", "rig", "timeout_s")
_PATIENCE_S = 5.0
_MOST_PIXELS = 64 * 1024 * 1024


class UrlSensor(CapturedSensor):
    """The stream at an address; nothing of it can be set from here."""

    def __init__(self, url: str, options: Options, *, frames: int | None = None, rate_hz: float | None = None) -> None:
        self.stamp_quality = StampQuality.ARRIVAL
        self._colour = options.flag("colour", default=True)
        timeout_s = options.number("timeout_s") or _PATIENCE_S
        name, rig = _shown(url), options.rig()
        capture = _opened(url, name, timeout_s)
        super().__init__(capture, name, rig=rig, timeout_s=timeout_s, frames=frames, rate_hz=rate_hz)

    @classmethod
    def parse(cls, argument: str, *, frames: int | None = None, rate_hz: float | None = None) -> UrlSensor:
        """Open `rtsp://user:word@host/path?query[#rig=oak-1&colour=0&timeout_s=5]`.

        Options stand behind `#`, which no server ever sees: `?` belongs to the camera.
        """
        url, _, text = argument.partition("#")
        return cls(url, Options(text, _OPTIONS), frames=frames, rate_hz=rate_hz)

    def _quality(self, *, by_driver: bool) -> StampQuality:
        del by_driver  # a position in the stream is no clock, even where it looks like one
        return StampQuality.ARRIVAL

    def _pixels(self, content: MatLike) -> NDArray[np.uint8]:
        if content.dtype != np.uint8 or content.size > 3 * _MOST_PIXELS:
            raise ImageError(
                f"{content.dtype} {content.shape} came: a frame has 8 bits and at most {_MOST_PIXELS} pixels"
            )
        found = content
        if content.ndim == 3 and not self._colour:
            found = cv2.cvtColor(content, cv2.COLOR_BGR2GRAY)
        return np.asarray(found).astype(np.uint8, copy=False)


def _shown(url: str) -> str:
    """Return what may be said of an address: `rtsp://host:port`."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise UsageError(
            "the address of the network camera cannot be read: give rtsp://HOST/... or http://HOST/..."
        ) from None
    if parts.scheme not in _SCHEMES or not host:
        raise UsageError(
            f"a network camera at {parts.scheme or 'no'}://{host or ''}: give an address with a host, that begins with "
            f"{', '.join(f'{scheme}://' for scheme in _SCHEMES)}"
        )
    host = f"[{host}]" if ":" in host else host
    return f"{parts.scheme}://{host}" + ("" if port is None else f":{port}")


def _opened(url: str, name: str, timeout_s: float) -> Capture:
    patience_ms = round(timeout_s * 1000)
    settings = (cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, patience_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, patience_ms)
    capture = cv2.VideoCapture(
        url, cv2.CAP_FFMPEG, [*settings, cv2.CAP_PROP_N_THREADS, 1]
    )  # more would hold frames back
    if not capture.isOpened():
        capture.release()
        raise DeviceError(
            f"no stream from {name} within {timeout_s:g} s: check address, path, user and password, and that it is on"
        )
    width, height = capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if not 0 < width * height <= _MOST_PIXELS:
        capture.release()
        raise DeviceError(f"{name} claims frames of {width:.0f}x{height:.0f} pixels: at most {_MOST_PIXELS} are read")
    return capture
