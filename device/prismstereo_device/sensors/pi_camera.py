"""What is used of the picamera2 library, and the stream sizes that a Raspberry Pi camera is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.sensors.base import SensorMode
from prismstereo_hw.errors import DeviceError, UsageError

__all__ = ["PiCamera", "PiRequest", "PiStreams", "chosen_streams", "listed_modes"]

_RATE_TOLERANCE = 0.05
_WHOLE_WIDTH = 0.99  # of the sensor's columns: a mode that leaves more out sees less than the rig needs


class PiRequest(Protocol):
    """One exposure with all its streams; whoever holds it keeps a buffer from the camera."""

    def make_array(self, name: str) -> NDArray[np.uint8]:
        """Copy out a stream."""
        ...

    def get_metadata(self) -> Mapping[str, Any]:
        """Return what the camera says of this exposure."""
        ...

    def release(self) -> None:
        """Give the buffer back."""
        ...


class PiCamera(Protocol):
    """`picamera2.Picamera2`, as far as it is used here."""

    camera_controls: Mapping[str, tuple[Any, Any, Any]]
    sensor_modes: Sequence[Mapping[str, Any]]

    def create_preview_configuration(self, **parts: object) -> dict[str, Any]:
        """Describe streams for a picture that runs."""
        ...

    def create_still_configuration(self, **parts: object) -> dict[str, Any]:
        """Describe streams for one picture."""
        ...

    def configure(self, camera_config: dict[str, Any]) -> None:
        """Take a configuration over."""
        ...

    def stream_configuration(self, name: str) -> Mapping[str, Any]:
        """Return what became of a stream."""
        ...

    def start(self) -> None:
        """Let frames come."""
        ...

    def set_controls(self, controls: Mapping[str, object]) -> None:
        """Set controls from the next free exposure on."""
        ...

    def capture_request(self, *, signal_function: Callable[[object], None]) -> object:
        """Begin to wait for the next exposure."""
        ...

    def switch_mode_and_capture_request(
        self, camera_config: dict[str, Any], *, signal_function: Callable[[object], None]
    ) -> object:
        """Begin to change the mode for one exposure, and to change back."""
        ...

    def wait(self, job: object) -> PiRequest:
        """Return what a job ended with."""
        ...

    def close(self) -> None:
        """Let go of the camera."""
        ...


@dataclass(frozen=True, slots=True)
class PiStreams:
    """The sensor mode to run, the two streams in (width, height) pixels, and the mode that has all the pixels."""

    mode: Mapping[str, Any]
    main: tuple[int, int]
    lores: tuple[int, int]
    full: Mapping[str, Any]
    rate_hz: float

    @property
    def still_in_main(self) -> bool:
        """Whether every video frame comes with all the sensor's pixels."""
        return tuple(self.mode["size"]) == tuple(self.full["size"])

    @property
    def full_size(self) -> tuple[int, int]:
        """All the sensor's pixels, in even numbers of columns and rows."""
        return _even(self.full["size"])

    def raw(self, mode: Mapping[str, Any]) -> dict[str, object]:
        """Describe the raw stream that makes the sensor run in a mode."""
        return {"size": _even(mode["size"]), "format": str(mode["unpacked"])}


def chosen_streams(modes: Sequence[Mapping[str, Any]], size: tuple[int, int], rate_hz: float) -> PiStreams:
    """Choose the mode with the most pixels that is fast enough and sees the sensor's whole width.

    `main` has exactly the proportions of `size`, so that the pixels of both streams are square.
    """
    whole = [mode for mode in modes if {"size", "fps", "crop_limits"} <= mode.keys()]
    if not whole:
        raise DeviceError("this camera tells no sensor modes: it is not on the CSI connector, open it with v4l2:DEVICE")
    width, height = size
    if width % 2 or height % 2:
        raise UsageError(f"{width}x{height} pixels: this camera gives even numbers of columns and rows")
    columns = max(mode["crop_limits"][2] for mode in whole)
    fitting = [
        mode
        for mode in whole
        if mode["crop_limits"][2] >= _WHOLE_WIDTH * columns
        and mode["size"][0] >= width
        and mode["size"][1] >= height
        and mode["fps"] >= rate_hz * (1 - _RATE_TOLERANCE)
    ]
    if not fitting:
        there = ", ".join(f"{mode['size'][0]}x{mode['size'][1]} up to {mode['fps']:g} Hz" for mode in whole)
        raise UsageError(f"no mode sees the whole width in {width}x{height} at {rate_hz:g} Hz: it has {there}")
    mode = max(fitting, key=lambda mode: (mode["size"][0] * mode["size"][1], mode["fps"]))
    full = max(whole, key=lambda mode: (mode["size"][0] * mode["size"][1], mode["fps"]))
    return PiStreams(mode, _largest(mode["size"], size), size, full, rate_hz)


def listed_modes(modes: Sequence[Mapping[str, Any]]) -> tuple[SensorMode, ...]:
    """Return the sensor's modes in the words of every sensor."""
    return tuple(
        SensorMode(mode["size"][0], mode["size"][1], str(mode["format"]), float(mode["fps"]))
        for mode in modes
        if {"size", "fps"} <= mode.keys()
    )


def _largest(mode: tuple[int, int], like: tuple[int, int]) -> tuple[int, int]:
    """Return the largest even size within a mode that has exactly the proportions of another size."""
    common = math.gcd(*like)
    across, down = like[0] // common, like[1] // common
    times = min(mode[0] // across, mode[1] // down)
    if across % 2 or down % 2:
        times -= times % 2
    return across * times, down * times


def _even(size: tuple[int, int]) -> tuple[int, int]:
    """Return the size that is left when no stream may have an odd number of columns or rows."""
    return size[0] - size[0] % 2, size[1] - size[1] % 2
