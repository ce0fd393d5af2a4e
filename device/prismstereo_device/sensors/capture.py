"""Frames of an OpenCV capture, drained by a thread of their own: the newest one counts, the others are dropped.

A capture hands out its oldest buffer. A matcher that is slower than the camera would fall behind by all of them, and a
network stream by seconds. So the buffers are emptied as they fill, and whoever reads gets the frame that came last.
"""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass
from typing import Protocol

import cv2
from cv2.typing import MatLike

from prismstereo_hw.errors import DeviceError

__all__ = ["Capture", "CaptureThread", "Grabbed"]

logger = logging.getLogger(__name__)

_OLDEST_STAMP_US = 10_000_000  # a driver's stamp further back than this is of another clock
_STAMP_SLACK_US = 2_000
_MOST_FAILURES = 100  # in a row: buffers come, but there is nothing in them
_JOIN_S = 12.0  # OpenCV waits 10 s for a camera that fell silent


class Capture(Protocol):
    """What is used of `cv2.VideoCapture`."""

    def grab(self) -> bool:
        """Wait for the next buffer; False once there are no more."""
        ...

    def retrieve(self) -> tuple[bool, MatLike]:
        """Copy out what was grabbed."""
        ...

    def get(self, propId: int, /) -> float:
        """Return a property."""
        ...

    def set(self, propId: int, value: float, /) -> bool:
        """Set a property; False where the backend knows at once that it cannot."""
        ...

    def release(self) -> None:
        """Let go of the camera."""
        ...


@dataclass(frozen=True, slots=True)
class Grabbed:
    """What one buffer held, its number among all that came, and when it came: `by_driver` if the driver says so."""

    content: MatLike
    number: int
    timestamp_us: int
    by_driver: bool


class CaptureThread:
    """Empties a capture until it ends, and lets go of it then: nobody else may touch the capture any more.

    `name` stands in every complaint. Numbers count from `first`; a gap between two frames tells how many were dropped.
    """

    def __init__(self, capture: Capture, name: str, first: int = 0) -> None:
        self.name = name
        self._capture, self._number = capture, first
        self._newest: Grabbed | None = None
        self._ended: str | None = None
        self._changed = threading.Condition()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._drain, name=f"capture {name}", daemon=True)
        self._thread.start()

    @property
    def next_number(self) -> int:
        """The number that the next buffer gets."""
        with self._changed:
            return self._number

    def newest(self, timeout_s: float) -> Grabbed:
        """Wait for a frame newer than the last one given; `DeviceError` when the camera went away or keeps silent."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._ended is not None, timeout_s)
            found, self._newest = self._newest, None
            if found is not None:
                return found
            if self._ended is not None:
                raise DeviceError(
                    f"{self.name} {self._ended}: check its cable and its power; it is opened again when back"
                )
        raise DeviceError(f"{self.name} gave no frame for {timeout_s:g} s: check its cable, its power and its light")

    def close(self) -> None:
        """Stop draining and let go of the camera."""
        self._stopping.set()
        self._thread.join(_JOIN_S)
        if self._thread.is_alive():
            logger.warning("%s does not let go: it hangs in its driver, and is left to itself", self.name)

    def _drain(self) -> None:
        ended = "was closed"
        try:
            ended = self._until_it_ends()
        except cv2.error as error:
            ended = f"failed in OpenCV ({error.err})"
        finally:
            self._capture.release()
            with self._changed:
                self._ended = ended
                self._changed.notify_all()

    def _until_it_ends(self) -> str:
        failures = 0
        while not self._stopping.is_set():
            if not self._capture.grab():
                return "stopped giving frames"
            arrived_us = time.monotonic_ns() // 1000
            found, content = self._capture.retrieve()
            failures = 0 if found else failures + 1
            if failures > _MOST_FAILURES:
                return f"gave {failures} empty frames in a row"
            with self._changed:
                if found:
                    stamp_us, by_driver = self._stamp(arrived_us)
                    self._newest = Grabbed(content, self._number, stamp_us, by_driver)
                self._number += 1
                self._changed.notify_all()
        return "was closed"

    def _stamp(self, arrived_us: int) -> tuple[int, bool]:
        """Return when the frame came, by the driver's clock if that is the system's monotonic one."""
        told_us = self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1000
        if arrived_us - _OLDEST_STAMP_US < told_us <= arrived_us + _STAMP_SLACK_US:
            return min(round(told_us), arrived_us), True
        return arrived_us, False
