"""A still: a full-sensor picture taken between two video frames, asked for, waited for, fetched and checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_device.wire import WireError
from prismstereo_hw.picture_head import picture_head

__all__ = ["StillPicture", "StillState"]

_MOST_PIXELS = 64 << 20
_AS_STORED = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION

_Pixel = Annotated[int, msgspec.Meta(ge=0, le=65535)]


class StillState(msgspec.Struct, frozen=True):
    """What the camera says of the still with number `id`; of a ready one, whose frame it is and what of the sensor it shows."""

    id: int
    state: Literal["none", "waiting", "ready", "failed"]
    frame: int = 0
    timestamp_us: int = 0
    crop: tuple[_Pixel, _Pixel, _Pixel, _Pixel] = (0, 0, 0, 0)
    why: str = ""

    @classmethod
    def read(cls, text: object) -> StillState:
        """Read the camera's words; raises WireError."""
        try:
            return msgspec.json.decode(str(text), type=cls)
        except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
            raise WireError(f"the state of a still cannot be read ({error}): {str(text)[:80]}") from error


@dataclass(frozen=True, slots=True)
class StillPicture:
    """`pixels` (height, width[, 3]) uint8, BGR, of the rectangle `crop` (x, y, width, height) of the full sensor.

    `frame` is the video frame that it belongs to, `timestamp_us` the device's clock at mid-exposure. `data` is the picture
    as it came, a PNG or JPEG file.
    """

    pixels: NDArray[np.uint8]
    data: bytes
    frame: int
    timestamp_us: int
    crop: tuple[int, int, int, int]

    @classmethod
    def of(cls, state: StillState, data: bytes) -> StillPicture:
        """Decode a still; raises WireError where it is not a whole picture of the declared size."""
        _, _, width, height = state.crop
        head = picture_head(data)
        if head is None or not head.whole or not 0 < width * height <= _MOST_PIXELS:
            raise WireError(f"still {state.id} of {len(data)} bytes is no whole picture: take another")
        if (head.width, head.height) != (width, height):  # asked before decoding: a small file can claim gigabytes
            raise WireError(
                f"still {state.id} claims {head.width}x{head.height} pixels, declared are {width}x{height}: take another"
            )
        try:
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), _AS_STORED)
        except cv2.error:
            pixels = None
        if pixels is None or pixels.shape[:2] != (height, width):
            raise WireError(f"still {state.id} is a damaged picture: take another")
        return cls(np.asarray(pixels, np.uint8), data, state.frame, state.timestamp_us, state.crop)
