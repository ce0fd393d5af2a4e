"""What is asked of an OAK camera: `[ID or address][?key=value&...]`, checked before any camera is looked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, cast

from prismstereo_device.sensors.oak.stereo_settings import StereoSettings
from prismstereo_device.sensors.options import Options
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig

__all__ = ["OakOptions"]

Mode = Literal["capture", "stereo"]
Pixels = Literal["nv12", "gray8"]

_SOCKETS = tuple(f"CAM_{letter}" for letter in "ABCDEFGHIJ")
_LEAST_SIDE_PX, _MOST_SIDE_PX = 32, 8192
_MOST_RATE_HZ = 240.0
_MOST_LENS_POSITION = 255
_KNOWN = (
    *("mode", "width", "height", "rate", "socket", "lens", "pixels", "stills", "rig"),
    *("bits", "extended", "shift", "median", "threshold", "confidence", "preview"),
)


@dataclass(frozen=True, slots=True)
class OakOptions:
    """One camera and what it shall give; `device` is an ID, an IP address or a USB path, empty for the first one found.

    `width`, `height` in pixels of the whole frame, both views in it. `lens` 0..255 is where the focus is locked; None: where
    the camera's factory calibration was made. `pixels` "nv12" brings colours, "gray8" two thirds of the bytes. `stills` keeps
    a full-resolution output open behind a gate. `stereo` is used in mode "stereo" only.
    """

    device: str = ""
    mode: Mode = "capture"
    width: int = 1280
    height: int = 720
    rate_hz: float = 30.0
    socket: str = "CAM_A"
    lens: int | None = None
    pixels: Pixels = "nv12"
    stills: bool = True
    rig: Rig | None = None
    stereo: StereoSettings = field(default_factory=StereoSettings)

    def __post_init__(self) -> None:
        """Refuse what no camera of this kind gives."""
        if self.width % 2 or self.height % 2:
            raise UsageError(f"frames of {self.width}x{self.height}: an OAK camera gives even numbers of pixels")
        if not 0 < self.rate_hz <= _MOST_RATE_HZ:
            raise UsageError(f"rate={self.rate_hz:g}: an OAK camera gives at most {_MOST_RATE_HZ:g} frames a second")

    @classmethod
    def parse(cls, argument: str, *, rate_hz: float | None = None) -> OakOptions:
        """Read what stands behind `oak:`; `rate_hz` is the most that is wished, whatever the argument names."""
        device, options = Options.behind(argument, _KNOWN)
        return cls(
            device=device,
            mode=cast(Mode, options.choice("mode", ("capture", "stereo"), "capture")),
            width=options.whole("width", _LEAST_SIDE_PX, _MOST_SIDE_PX) or 1280,
            height=options.whole("height", _LEAST_SIDE_PX, _MOST_SIDE_PX) or 720,
            rate_hz=_rate_hz(options.number("rate"), rate_hz),
            socket=options.choice("socket", _SOCKETS, "CAM_A"),
            lens=options.whole("lens", 0, _MOST_LENS_POSITION),
            pixels=cast(Pixels, options.choice("pixels", ("nv12", "gray8"), "nv12")),
            stills=options.flag("stills", default=True),
            rig=options.rig(),
            stereo=StereoSettings.parse(options),
        )


def _rate_hz(named_hz: float | None, most_hz: float | None) -> float:
    if named_hz is None:
        return 30.0 if most_hz is None else min(most_hz, _MOST_RATE_HZ)
    return named_hz if most_hz is None else min(named_hz, most_hz)
