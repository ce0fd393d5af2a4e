"""Frames by callback: a thread that calls a function with the newest frame, again and again."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Self

from prismstereo.camera_frame import CameraFrame
from prismstereo.inbox import Stream
from prismstereo_hw.errors import DeviceError

__all__ = ["FrameCalls"]

_JOIN_S = 5.0


class FrameCalls:
    """Calls `call(frame)` with what a stream gives, in a thread of its own, until either ends; a context manager.

    What `call` raises ends it, and is shown as any thread's exception is. That a camera is lost for good is told by its
    `on_event`, not here.
    """

    def __init__(self, frames: Stream[CameraFrame], call: Callable[[CameraFrame], object]) -> None:
        self._frames = frames
        self._call = call
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="prismstereo-frames", daemon=True)
        self._thread.start()

    @property
    def not_taken(self) -> int:
        """How many frames were pushed out by newer ones before they were taken."""
        return self._frames.not_taken

    @property
    def running(self) -> bool:
        """Whether frames are still waited for."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Call no more, and wait for the call under way; from within it, return at once. Stopping twice does no harm."""
        self._stopping.set()
        self._frames.close()
        if self._thread is not threading.current_thread():
            self._thread.join(_JOIN_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _run(self) -> None:
        with self._frames:
            while (frame := self._taken()) is not None and not self._stopping.is_set():
                self._call(frame)

    def _taken(self) -> CameraFrame | None:
        with suppress(DeviceError):  # lost for good: the camera's events say so
            return self._frames.take()
        return None
