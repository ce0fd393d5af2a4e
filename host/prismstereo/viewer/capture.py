"""Captured pictures as a session folder: stills, each with a raw video frame of the same moment, and the empty scene."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from prismstereo.still import StillPicture
from prismstereo_calibration import schema
from prismstereo_calibration.model import Calibration
from prismstereo_hw.files import write_picture, write_whole
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import Rig
from prismstereo_hw.session import SessionWriter

__all__ = ["Capture", "Shot"]

Shot = Literal["still", "background"]


class Capture:
    """A session folder that grows picture by picture and is whole after each of them."""

    def __init__(self, folder: Path, rig: Rig, calibration: Calibration | None) -> None:
        self.folder = folder
        self._writer = SessionWriter(folder, rig)
        self._count = 0
        if calibration is not None:
            write_whole(folder / "calibration.json", schema.encode(calibration))

    def add(self, shot: Shot, still: StillPicture, video: RawFrame) -> str:
        """Write a still and its video frame and return the still's place in the folder; `DataError` where that fails."""
        if shot == "background":
            write_picture(self.folder / "background" / "video.png", video.pixels)
            write_picture(self.folder / "background" / "still.png", still.pixels)
            place = "background/still.png"
        else:
            self._writer.add("video", RawFrame(video.pixels, self._count, video.timestamp_us, video.lens_position))
            path = self._writer.add("stills", RawFrame(still.pixels, self._count, still.timestamp_us))
            self._count += 1
            place = f"stills/{path.name}"
        self._writer.finish()
        return place
