"""A camera that comes back: what reads it opens it again when it went away, and again, with growing pauses."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from prismstereo_device.sensors.base import Sensor
from prismstereo_hw.errors import DeviceError, PrismStereoError
from prismstereo_hw.frame import RawFrame

__all__ = ["Patience", "ReopeningSensor"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Patience:
    """How long to wait for a camera that went away: pauses from `first_s`, doubled up to `longest_s`, until `give_up_s`."""

    first_s: float = 0.2
    longest_s: float = 5.0
    give_up_s: float | None = None  # None: for ever


class ReopeningSensor:
    """Reads frames of a sensor, and of its successors once it went away; their numbers go on rising.

    `reopen` opens the camera again; without it a camera that goes away ends the frames. `prepare` sets a fresh sensor as the
    one before was. `waiting` is called between attempts, at least every `longest_s`. Used by the frame loop alone, but for
    `stop`.
    """

    def __init__(
        self,
        sensor: Sensor,
        reopen: Callable[[], Sensor] | None,
        *,
        patience: Patience | None = None,
        prepare: Callable[[Sensor], None],
        waiting: Callable[[str], None],
    ) -> None:
        self._sensor, self._reopen = sensor, reopen
        self._patience = patience or Patience()
        self._prepare, self._waiting = prepare, waiting
        self._stopped = threading.Event()
        self._next_index = self._first_index = 0
        self._losses = 0
        self._open = True

    @property
    def sensor(self) -> Sensor:
        """The sensor that is read now."""
        return self._sensor

    @property
    def losses(self) -> int:
        """How often the camera went away."""
        return self._losses

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stopped.is_set()

    def read(self) -> RawFrame | None:
        """Wait for the next frame; None after the last, or once stopped. `DeviceError` when patience has ended."""
        while not self._stopped.is_set():
            try:
                frame = self._sensor.read()
            except DeviceError as error:
                if self._reopen is None:
                    raise
                self._come_back(self._reopen, error)
                continue
            return None if frame is None else self._numbered(frame)
        return None

    def stop(self) -> None:
        """Wait no longer for a camera that is away; from any thread."""
        self._stopped.set()

    def close(self) -> None:
        """Let go of the camera."""
        self._stopped.set()
        self._let_go()

    def _numbered(self, frame: RawFrame) -> RawFrame:
        index = frame.index + self._first_index
        self._next_index = index + 1
        return frame if index == frame.index else replace(frame, index=index)

    def _come_back(self, reopen: Callable[[], Sensor], error: DeviceError) -> None:
        """Open the camera again, however long that takes; DeviceError when patience has ended."""
        self._losses += 1
        logger.error("the camera went away (%s): it is opened again", error)  # hosts are told the last error
        self._let_go()
        began_s, pause_s = time.monotonic(), self._patience.first_s
        give_up_s = self._patience.give_up_s
        while not self._stopped.is_set():
            self._waiting(str(error))
            if self._stopped.wait(pause_s) or self._opened(reopen):
                return
            pause_s = min(2 * pause_s, self._patience.longest_s)
            if give_up_s is not None and time.monotonic() - began_s > give_up_s:
                raise DeviceError(
                    f"the camera did not come back within {give_up_s:g} s ({error}): check its cable and its power"
                ) from error

    def _opened(self, reopen: Callable[[], Sensor]) -> bool:
        try:
            sensor = reopen()
        except PrismStereoError as error:
            logger.debug("not yet: %s", error)
            return False
        self._sensor, self._open = sensor, True
        self._first_index = self._next_index + 1  # the gap tells the host
        try:
            self._prepare(sensor)
        except DeviceError:
            self._let_go()
            return False
        logger.warning("the camera is back")
        return True

    def _let_go(self) -> None:
        if self._open:
            self._open = False
            self._sensor.close()
