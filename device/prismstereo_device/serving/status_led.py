"""A lamp on the camera that shows what the service is about."""

from __future__ import annotations

import contextlib
import logging
from enum import Enum
from pathlib import Path
from typing import Protocol

__all__ = ["FolderLed", "LedState", "NoLed", "StatusLed"]

logger = logging.getLogger(__name__)


class LedState(Enum):
    """What the lamp can show: (on, off) in milliseconds. It blinks where both are more than 0."""

    OFF = (0, 1000)
    STARTING = (250, 250)
    WAITING = (100, 1900)
    STREAMING = (1000, 0)
    FAULT = (100, 100)


class StatusLed(Protocol):
    """Anything that can show a state. It never raises: a lamp is no reason to stop a camera."""

    def show(self, state: LedState) -> None:
        """Show a state from now on; the same one again costs nothing."""
        ...


class NoLed:
    """A camera without a lamp."""

    def show(self, state: LedState) -> None:
        """Show nothing."""


class FolderLed:
    """A lamp of the Linux kernel: a folder below /sys/class/leds. The kernel does the blinking, by its timer trigger.

    Where there is no such trigger the lamp is lit while frames are sent, and dark otherwise.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._shown: LedState | None = None
        self._broken = False

    def show(self, state: LedState) -> None:
        """Show a state; a lamp that cannot be set is given up after one warning."""
        if state is self._shown or self._broken:
            return
        self._shown = state
        try:
            self._set(state)
        except (OSError, ValueError) as error:
            self._broken = True
            logger.warning("the lamp %s cannot be set (%s): it stays as it is", self._folder, error)

    def _set(self, state: LedState) -> None:
        on_ms, off_ms = state.value
        triggers = (self._folder / "trigger").read_text("ascii").replace("[", " ").replace("]", " ").split()
        if on_ms and off_ms and "timer" in triggers:
            self._write("trigger", "timer")  # makes the two files below
            self._write("delay_on", str(on_ms))
            self._write("delay_off", str(off_ms))
            return
        with contextlib.suppress(OSError):  # a lamp whose only trigger is none refuses even that
            self._write("trigger", "none")
        brightness = 0 if off_ms else int((self._folder / "max_brightness").read_text("ascii"))
        self._write("brightness", str(brightness))

    def _write(self, name: str, value: str) -> None:
        (self._folder / name).write_text(value, "ascii")
