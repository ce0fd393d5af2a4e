"""Fragment 0 of a picture: what its bytes are, checked before any of them is decoded."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, Self

from prismstereo_device.protocol.body import read_fields, read_grown
from prismstereo_device.wire import LIMITS, Channel, WireError

__all__ = ["PictureEncoding", "PictureHead", "PictureKind"]

_LENS_UNKNOWN = -1
_CHANNELS = (1, 3)


class PictureKind(IntEnum):
    """What a picture shows; each kind has a channel of its own."""

    PREVIEW = 1  # the rectified left view
    RAW = 2  # the sensor's frame, both views in it
    REASONS = 3  # a `Reason` for every `step`-th pixel of the disparity map
    CONFIDENCE = 4  # how sure every `step`-th match is, 0..255

    @property
    def channel(self) -> Channel:
        """Where it travels."""
        return _CHANNEL[self]


_CHANNEL = {
    PictureKind.PREVIEW: Channel.IMG,
    PictureKind.RAW: Channel.RAW,
    PictureKind.REASONS: Channel.REASON,
    PictureKind.CONFIDENCE: Channel.CONFIDENCE,
}


class PictureEncoding(IntEnum):
    """How its pixels are compressed."""

    JPEG = 1  # sequential, of one scan
    PNG = 2
    ZSTD = 3  # one frame with its size and check sum, rows from the top, no gaps between them


@dataclass(frozen=True, slots=True)
class PictureHead:
    """A picture of `width` x `height` pixels of 8 bits in 1 channel (grey) or 3 (blue, green, red), `size` bytes compressed.

    It belongs to frame `frame`, exposed at `timestamp_us`. `crop` is the rectangle (x, y, width, height) that it shows of
    the whole raw frame (RAW) or of the rectified view (the others), of which every `step`-th pixel is there, from the first on.
    """

    kind: PictureKind
    encoding: PictureEncoding
    frame: int
    timestamp_us: int
    width: int
    height: int
    channels: int
    crop: tuple[int, int, int, int]
    step: int
    size: int
    lens_position: int | None = None

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBIQHHBHHHHBI")
    _LENS: ClassVar[struct.Struct] = struct.Struct("<i")

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the pixels' array: (height, width) or (height, width, 3)."""
        return (self.height, self.width) if self.channels == 1 else (self.height, self.width, self.channels)

    @property
    def samples(self) -> int:
        """Bytes of the pixels, decoded."""
        return self.width * self.height * self.channels

    def pack(self) -> bytes:
        """Give the body's bytes."""
        what = (self.kind, self.encoding, self.frame, self.timestamp_us, self.width, self.height, self.channels)
        body = self._LAYOUT.pack(*what, *self.crop, self.step, self.size)
        return body + self._LENS.pack(_LENS_UNKNOWN if self.lens_position is None else self.lens_position)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a head and hold it against every limit; raises WireError."""
        fields = read_fields(cls._LAYOUT, body, "a picture head")
        kind, encoding, frame, timestamp_us, width, height, channels, *crop, step, size = fields
        try:
            kind, encoding = PictureKind(kind), PictureEncoding(encoding)
        except ValueError as error:
            raise WireError(
                f"a picture of kind {kind}, encoding {encoding}: this version has no such ({error})"
            ) from error
        (lens,) = read_grown(cls._LENS, body, cls._LAYOUT.size) or (_LENS_UNKNOWN,)
        x, y, crop_width, crop_height = crop
        place = (x, y, crop_width, crop_height)
        head = cls(
            kind, encoding, frame, timestamp_us, width, height, channels, place, step, size, None if lens < 0 else lens
        )
        head.check()
        return head

    def check(self) -> None:
        """Raise WireError where a number is beyond the limits, or the size is not the crop's."""
        side = LIMITS.picture_side if self.kind is PictureKind.RAW else LIMITS.frame_side
        if not (1 <= self.width <= side and 1 <= self.height <= side and self.channels in _CHANNELS):
            raise WireError(
                f"a picture of {self.width} x {self.height} x {self.channels}: 1 to {side} pixels each way, "
                f"{_CHANNELS[0]} or {_CHANNELS[1]} channels"
            )
        if self.samples > LIMITS.picture_samples:
            raise WireError(f"a picture of {self.samples} bytes, decoded: at most {LIMITS.picture_samples}")
        if not 1 <= self.size <= LIMITS.picture:
            raise WireError(f"a picture of {self.size} bytes: 1 to {LIMITS.picture}")
        shown = tuple(-(-side // max(self.step, 1)) for side in self.crop[2:])
        if self.step < 1 or shown != (self.width, self.height):
            raise WireError(
                f"a picture of {self.width} x {self.height} that shows every pixel number {self.step} of {self.crop}: "
                f"these are {shown[0]} x {shown[1]}"
            )
