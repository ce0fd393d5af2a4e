"""Frames and the preview pictures that belong to them, which come a little later on the line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.protocol import ReceivedFrame, ReceivedPicture
from prismstereo_device.wire import WireError

__all__ = ["PICTURES_LATE", "Paired", "Pairing"]

PICTURES_LATE = 4  # frames: a picture takes longer on the line than its map, and comes behind a few newer ones
_PICTURES_KEPT = 16

Paired = tuple[ReceivedFrame, NDArray[np.uint8] | None]


@dataclass(slots=True)
class Pairing:
    """Holds a frame back until its picture is there, or newer frames have come."""

    _frames: list[ReceivedFrame] = field(default_factory=list)
    _pictures: dict[int, ReceivedPicture] = field(default_factory=dict)

    def picture(self, picture: ReceivedPicture) -> None:
        """Take a picture; the oldest of many that nobody asked for is forgotten."""
        self._pictures[picture.head.frame] = picture
        if len(self._pictures) > _PICTURES_KEPT:
            del self._pictures[next(iter(self._pictures))]

    def frame(self, frame: ReceivedFrame) -> None:
        """Take a frame."""
        self._frames.append(frame)

    @property
    def oldest(self) -> int | None:
        """Number of the frame that waits longest for its picture; None where none waits."""
        waits = self._frames and self._frames[0].index not in self._pictures
        return self._frames[0].index if waits else None

    def ready(self, late: int = PICTURES_LATE) -> Iterator[Paired]:
        """Give the frames whose picture is there, and those that more than `late` newer ones have followed."""
        while self._frames and (self.oldest is None or len(self._frames) > late):
            frame = self._frames.pop(0)
            yield frame, _decoded(self._pictures.pop(frame.index, None))


def _decoded(picture: ReceivedPicture | None) -> NDArray[np.uint8] | None:
    try:
        return None if picture is None else picture.pixels()
    except WireError:  # damaged on its way: the frame goes without
        return None
