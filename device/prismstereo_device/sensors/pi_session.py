"""A picamera2 camera in use: one request held at a time, no wait for ever, its complaints in our words."""

from __future__ import annotations

import importlib
import logging
import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.sensors.pi_camera import PiCamera, PiRequest
from prismstereo_hw.errors import DeviceError

__all__ = ["PiSession"]

logger = logging.getLogger(__name__)

_SILENCE_S, _STILL_SILENCE_S, _CLOSE_S = 3.0, 8.0, 5.0
_LIBRARY_ERRORS = (RuntimeError, OSError, IndexError, ValueError)
_T = TypeVar("_T")


class PiSession:
    """Holds the newest request until the next one, so that its streams can still be copied; `DeviceError` on silence.

    Controls are remembered: a change of the camera's mode forgets them.
    """

    def __init__(self, camera: PiCamera, name: str) -> None:
        self.camera, self.name = camera, name
        self.controls: dict[str, object] = {}
        self.held: PiRequest | None = None

    @classmethod
    def open(cls, index: int) -> PiSession:
        """Open a camera by number; `DeviceError` where there is none, or no library."""
        try:
            library = importlib.import_module("picamera2")
        except ImportError as error:
            raise DeviceError(
                "the library picamera2 is not there: on Raspberry Pi OS install python3-picamera2 with apt, and make the "
                "environment with --system-site-packages"
            ) from error
        name = f"Raspberry Pi camera {index}"
        try:
            there = library.Picamera2.global_camera_info()
            if index < len(there):
                return cls(library.Picamera2(index), name)
        except _LIBRARY_ERRORS as error:
            raise DeviceError(f"cannot open the {name} ({error}): end the program that has it") from error
        models = ", ".join(f"{number} {camera.get('Model', '?')}" for number, camera in enumerate(there))
        raise DeviceError(f"there is no {name}: there is {models or 'none, check the ribbon cable'}")

    def ask(self, call: Callable[[], _T]) -> _T:
        """Call the library; its errors become `DeviceError`."""
        try:
            return call()
        except _LIBRARY_ERRORS as error:
            raise DeviceError(f"the {self.name} failed ({error}): check its ribbon cable") from error

    def set(self, controls: Mapping[str, object]) -> None:
        """Set controls, and all that were set before once more."""
        self.controls |= controls
        self.ask(lambda: self.camera.set_controls(dict(self.controls)))

    def next(self) -> Mapping[str, Any]:
        """Wait for the newest request that was not taken yet, hold it, and return what the camera says of it."""
        self.let_go()
        self.held = request = self._awaited(
            lambda signal: self.camera.capture_request(signal_function=signal), _SILENCE_S
        )
        return self.ask(request.get_metadata)

    def planes(self, stream: str) -> NDArray[np.uint8]:
        """Copy a stream out of the request that is held; there is one after `next`."""
        held = self.held
        assert held is not None
        return self.ask(lambda: held.make_array(stream))

    def in_another_mode(self, configuration: dict[str, Any]) -> tuple[NDArray[np.uint8], Mapping[str, Any]]:
        """Change the mode for one picture and back; return its `main` and what the camera says of it."""
        self.let_go()
        request = self._awaited(
            lambda signal: self.camera.switch_mode_and_capture_request(configuration, signal_function=signal),
            _STILL_SILENCE_S,
        )
        try:
            return self.ask(lambda: request.make_array("main")), self.ask(request.get_metadata)
        finally:
            self.ask(request.release)
            self.set({})

    def let_go(self) -> None:
        """Give the held buffer back to the camera."""
        if self.held is not None:
            held, self.held = self.held, None
            self.ask(held.release)

    def close(self) -> None:
        """Let go of the camera; one that hangs is left to itself."""
        self.let_go()
        closing = threading.Thread(target=self._close, name=f"close {self.name}", daemon=True)
        closing.start()
        closing.join(_CLOSE_S)
        if closing.is_alive():
            logger.warning("the %s does not close: it hangs, and is left to itself", self.name)

    def _close(self) -> None:
        try:
            self.camera.close()
        except _LIBRARY_ERRORS as error:
            logger.warning("the %s did not close in order: %s", self.name, error)

    def _awaited(self, begin: Callable[[Callable[[object], None]], object], patience_s: float) -> PiRequest:
        done = threading.Event()
        job = self.ask(lambda: begin(lambda _: done.set()))
        if not done.wait(patience_s):
            raise DeviceError(
                f"the {self.name} gave no frame for {patience_s:g} s: check its ribbon cable, then restart"
            )
        return self.ask(lambda: self.camera.wait(job))
