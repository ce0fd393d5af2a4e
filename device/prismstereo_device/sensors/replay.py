"""Recorded frames behind the same interface as a camera."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from prismstereo_device.sensors.base import Pace, Sensor
from prismstereo_hw.errors import ImageError, SessionError
from prismstereo_hw.files import read_picture
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.session import Session

__all__ = ["ReplaySensor"]

_SUFFIXES = {".png", ".jpg", ".jpeg", ".pgm", ".tif", ".tiff", ".bmp"}
_ASSUMED_RATE_HZ = 30.0


class ReplaySensor(Sensor):
    """Gives the frames of a session folder, of a folder of pictures in order of their names, or of one picture."""

    def __init__(self, path: str | Path, *, frames: int | None = None, rate_hz: float | None = None) -> None:
        path = Path(path)
        self._pace = Pace(rate_hz)
        if os.path.isfile(path / "session.toml"):
            session = Session.open(path)
            if not session.paths("video"):
                raise SessionError(f"{path} holds no video frames: there is nothing to replay")
            self.rig = Rig.read(path / "rig.toml") if (path / "rig.toml").is_file() else None
            source = session.frames("video")
        else:
            source = _pictures(path)
        self._source = islice(source, frames)

    def read(self) -> RawFrame | None:
        """Read the next frame; None after the last."""
        self._pace.wait()
        return next(self._source, None)


def _pictures(path: Path) -> Iterator[RawFrame]:
    if os.path.isdir(path):
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in _SUFFIXES)
    else:
        files = [path] if os.path.isfile(path) else []
    if not files:
        raise ImageError(
            f"there is nothing to replay at {path}: give a session folder, a folder of pictures or a picture"
        )
    return (
        RawFrame(read_picture(file), index, round(index * 1e6 / _ASSUMED_RATE_HZ)) for index, file in enumerate(files)
    )
