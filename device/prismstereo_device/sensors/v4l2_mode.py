"""The mode that a Video4Linux camera is asked for: what the user wished, and the best of what is left open."""

from __future__ import annotations

from prismstereo_device.sensors.base import SensorMode
from prismstereo_device.sensors.options import Options
from prismstereo_device.sensors.pixel_formats import PIXEL_FORMATS
from prismstereo_device.sensors.wishes import wished_size
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Mode

__all__ = ["chosen_mode"]

_USUAL = (640, 480)  # what nearly every camera has
_ENOUGH_HZ = 30.0
_RATE_TOLERANCE = 0.05


def chosen_mode(modes: tuple[SensorMode, ...], options: Options, video: Mode | None) -> SensorMode:
    """Choose among a camera's modes by width, height, format and rate; `UsageError` lists what there is instead.

    Without a size it is that of the rig's video mode, else 640x480. Without a format it is the one that runs fastest up to
    30 Hz, and of equals the first in `PIXEL_FORMATS`: colour before grey, uncompressed
    before JPEG. Without a rate the driver decides.
    """
    of_the_rig = _USUAL if video is None else (video.width, video.height)
    width, height = wished_size(options) or of_the_rig
    wished, rate_hz = options.text("format"), options.number("rate")
    if wished is not None and wished not in PIXEL_FORMATS:
        raise UsageError(f"format={wished}: give one of {', '.join(PIXEL_FORMATS)}")
    readable = [mode for mode in modes if mode.pixel_format in PIXEL_FORMATS]
    if not readable:  # a driver that lists nothing: it will say itself what it cannot do
        return SensorMode(width, height, wished or "YUYV", rate_hz or 0.0)
    fitting = [mode for mode in readable if (mode.width, mode.height) == (width, height)] or _between(
        readable, width, height
    )
    fitting = [mode for mode in fitting if wished in (None, mode.pixel_format) and _fast_enough(mode, rate_hz)]
    if not fitting:
        raise UsageError(
            f"the camera has no mode {width}x{height}{'' if wished is None else ' ' + wished}"
            f"{'' if rate_hz is None else f' at {rate_hz:g} Hz'}: give one of {_listed(readable)}"
        )
    best = min(fitting, key=lambda mode: (-min(mode.rate_hz, _ENOUGH_HZ), PIXEL_FORMATS.index(mode.pixel_format)))
    return SensorMode(width, height, best.pixel_format, rate_hz or 0.0)


def _between(modes: list[SensorMode], width: int, height: int) -> list[SensorMode]:
    """Return the modes of formats whose sizes reach from below the wished one to above it."""
    return [
        mode
        for mode in modes
        if mode.width >= width
        and mode.height >= height
        and any(
            less.pixel_format == mode.pixel_format and less.width <= width and less.height <= height for less in modes
        )
    ]


def _fast_enough(mode: SensorMode, rate_hz: float | None) -> bool:
    return rate_hz is None or not mode.rate_hz or mode.rate_hz >= rate_hz * (1 - _RATE_TOLERANCE)


def _listed(modes: list[SensorMode]) -> str:
    return ", ".join(
        dict.fromkeys(f"{mode.width}x{mode.height} {mode.pixel_format} {mode.rate_hz:g} Hz" for mode in modes)
    )
