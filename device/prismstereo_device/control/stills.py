"""Stills: full-sensor pictures between video frames, each with the number that its request had.

Taken in the frame loop, cut to the wished crop there, and compressed beside it, so that the stream goes on meanwhile.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Literal

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.objects import Held
from prismstereo_device.sensors.base import Sensor, SensorMode, Still
from prismstereo_hw.errors import DataError, DeviceError, ImageError, UsageError

__all__ = ["Encoding", "StillRequest", "Stills"]

Encoding = Literal["png", "jpeg"]
State = Literal["none", "waiting", "ready", "failed"]
Crop = tuple[int, int, int, int]

_MOST_NUMBER = 0xFFFF_FFFF
_JPEG_QUALITY = 95
_SHORT = 60  # characters of a reason: the whole has to fit a packet


@dataclass(frozen=True, slots=True)
class StillRequest:
    """A wished still: its number (1 .. 2^32 - 1) and the crop (x, y, width, height) in full-sensor pixels, None for all."""

    number: int
    crop: Crop | None = None

    @classmethod
    def of(cls, value: object, modes: tuple[SensorMode, ...] = ()) -> StillRequest:
        """Read [number] or [number, x, y, width, height]; `UsageError` where it is neither, or leaves every mode."""
        if not (isinstance(value, list) and len(value) in (1, 5) and all(type(part) is int for part in value)):
            raise UsageError(f"still {str(value)[:40]}: give [number] or [number, x, y, width, height]")
        number, *crop = value
        if not 0 < number <= _MOST_NUMBER:
            raise UsageError(f"still {number}: number it from 1 to {_MOST_NUMBER}")
        if not crop:
            return cls(number)
        x, y, width, height = crop
        if modes:
            _require_inside(
                (x, y, width, height), max(mode.width for mode in modes), max(mode.height for mode in modes)
            )
        elif min(x, y) < 0 or min(width, height) < 1:
            raise UsageError(f"crop {crop}: give x, y from 0 and width, height from 1")
        return cls(number, (x, y, width, height))


class _Told(msgspec.Struct, frozen=True, omit_defaults=True):
    """What `get still` says: the request's number and state; of a ready one, whose frame and what of the sensor it is."""

    id: int
    state: State
    frame: int | None = None
    timestamp_us: int | None = None
    crop: Crop | None = None
    size: int | None = None
    why: str = ""


class Stills:
    """The one still that is kept, and the one that is asked for; `keep` puts a finished one where hosts read it."""

    def __init__(self, keep: Callable[[Held], None], worker: Executor, encoding: Encoding = "png") -> None:
        self._keep, self._worker, self._encoding = keep, worker, encoding
        self._lock = threading.Lock()
        self._told = _Told(0, "none")
        self._waiting: StillRequest | None = None

    def ask(self, request: StillRequest) -> bool:
        """Ask for a still; asking again for the newest one changes nothing. False: another one is under way."""
        with self._lock:
            if request.number == self._told.id:
                return True
            if self._told.state == "waiting":
                return False
            self._told, self._waiting = _Told(request.number, "waiting"), request
            return True

    @property
    def state(self) -> str:
        """The newest request's state as JSON: id, state, and of a ready one frame, timestamp_us, crop, size in bytes."""
        return msgspec.json.encode(self._told).decode()

    def serve(self, sensor: Sensor) -> None:
        """Take the still that waits, if one does: called between two frames. A camera that goes away fails the still only."""
        request = self._taken()
        if request is None:
            return
        try:
            still = sensor.still()
            pixels, crop = _cut(still, request.crop)
        except (DeviceError, DataError, UsageError) as error:
            self._tell(_Told(request.number, "failed", why=str(error)[:_SHORT]))
            return
        self._worker.submit(self._finish, request, still, pixels, crop)

    def fail(self, why: str) -> None:
        """Say why the still that waits cannot be taken."""
        request = self._taken()
        if request is not None:
            self._tell(_Told(request.number, "failed", why=why[:_SHORT]))

    def _taken(self) -> StillRequest | None:
        with self._lock:
            request, self._waiting = self._waiting, None
        return request

    def _finish(self, request: StillRequest, still: Still, pixels: NDArray[np.uint8], crop: Crop) -> None:
        try:
            content = _compressed(pixels, self._encoding)
        except (cv2.error, DataError) as error:
            self._tell(_Told(request.number, "failed", why=f"not compressed: {error}"[:_SHORT]))
            return
        self._keep(Held(request.number, content))
        frame = still.frame
        self._tell(_Told(request.number, "ready", frame.index, frame.timestamp_us, crop, len(content)))

    def _tell(self, told: _Told) -> None:
        with self._lock:
            self._told = told


def _cut(still: Still, wished: Crop | None) -> tuple[NDArray[np.uint8], Crop]:
    """Cut a wished crop of the full sensor out of what the still shows of it."""
    if wished is None:
        return still.frame.pixels, still.crop
    left, top, width, height = still.crop
    x, y, w, h = wished
    _require_inside((x - left, y - top, w, h), width, height)
    return np.ascontiguousarray(still.frame.pixels[y - top : y - top + h, x - left : x - left + w]), wished


def _require_inside(crop: Crop, width: int, height: int) -> None:
    x, y, w, h = crop
    if min(x, y) < 0 or min(w, h) < 1 or x + w > width or y + h > height:
        raise UsageError(f"crop {list(crop)} leaves the sensor: give x, y, width, height inside {width}x{height}")


def _compressed(pixels: NDArray[np.uint8], encoding: Encoding) -> bytes:
    if encoding == "png":
        done, content = cv2.imencode(".png", pixels)
    else:
        done, content = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not done:
        raise ImageError(
            f"a still of {pixels.shape[1]}x{pixels.shape[0]} pixels has no {encoding} form: ask for a crop"
        )
    return content.tobytes()
