"""Messages of a running camera, and the camera started again when it went away: a pulled cable is no end of the stream."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from datetime import timedelta
from types import ModuleType
from typing import Any, Generic, TypeVar

from prismstereo_device.sensors.oak.opening import Running
from prismstereo_hw.errors import DeviceError

__all__ = ["FrameQueue"]

logger = logging.getLogger(__name__)

Ports = TypeVar("Ports")

_LOOK = timedelta(milliseconds=200)  # a signal is heard between two looks
_SILENT_S = 5.0
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 8.0


class FrameQueue(Generic[Ports]):
    """Gives the messages of one queue of a graph, numbered without a break however often the camera came back.

    `begin` opens and starts the camera, `queue` picks the queue. Silence of `silent_s` counts as gone. `DeviceError` once it
    did not come back within `patience_s`.
    """

    def __init__(
        self,
        dai: ModuleType,
        begin: Callable[[], Running[Ports]],
        queue: Callable[[Ports], Any],
        *,
        patience_s: float = 30.0,
        silent_s: float = _SILENT_S,
    ) -> None:
        self._dai, self._begin, self._queue = dai, begin, queue
        self._patience_s, self._silent_s = patience_s, silent_s
        self._running = begin()
        self._offset: int | None = 0
        self._newest = -1

    @property
    def running(self) -> Running[Ports]:
        """The camera as it runs now."""
        return self._running

    @property
    def newest(self) -> int:
        """The number of the newest message given; -1 before the first."""
        return self._newest

    def next(self, restored: Callable[[], None]) -> tuple[Any, int]:
        """Wait for a message; return it and its number: the camera's count, a gap for what it dropped.

        `restored` is called where the camera came back on the way: it puts back what was set.
        """
        while True:
            message = self._waited()
            if message is not None:
                self._newest = max(self.number(message), self._newest + 1)
                return message, self._newest
            self._start_again()
            restored()

    def number(self, message: Any) -> int:
        """Return the number of a message of any queue of this camera: messages of one exposure have the same."""
        sequence = int(message.getSequenceNum())
        if self._offset is None:
            self._offset = self._newest + 1 - sequence
        return sequence + self._offset

    def close(self) -> None:
        """Stop the camera."""
        self._running.stop()

    def _waited(self) -> Any | None:
        """Return the next message, None when the camera is gone."""
        until_s = time.monotonic() + self._silent_s
        try:
            while time.monotonic() < until_s:
                message = self._queue(self._running.ports).get(_LOOK)
                if message is not None:
                    return message
        except (self._dai.MessageQueue.QueueException, RuntimeError) as error:
            logger.warning("the OAK camera went away: %s", error)
            return None
        logger.warning("the OAK camera gave no frame for %.1f s", self._silent_s)
        return None

    def _start_again(self) -> None:
        self._running.stop()
        begun_s, pause_s = time.monotonic(), _FIRST_PAUSE_S
        while True:
            try:
                self._running = self._begin()
                break
            except DeviceError as error:
                if time.monotonic() - begun_s + pause_s > self._patience_s:
                    raise DeviceError(f"the OAK camera went away and did not come back: {error}") from error
                logger.info("not back yet: %s", error)
            time.sleep(pause_s)
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
        self._offset = None
