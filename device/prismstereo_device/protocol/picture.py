"""Pictures on the wire: previews, raw frames, and planes of reasons and confidence; the newest of each kind wins.

The first fragment is the head alone; each of the others is `frame u32, offset u32, bytes`. A picture of which a packet is
lost is not delivered: half a compressed picture is none.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.framing import Packet
from prismstereo_device.protocol.body import read_fields
from prismstereo_device.protocol.picture_bytes import check_bytes, compress, decompress
from prismstereo_device.protocol.picture_head import PictureEncoding, PictureHead, PictureKind
from prismstereo_device.wire import FIRST, LAST, WireError

__all__ = ["PictureAssembler", "PictureStatistics", "ReceivedPicture", "picture_fragments"]

_PREFIX = struct.Struct("<II")
_FRAME = 0xFFFF_FFFF
_QUALITY = 80
_ENCODING = {
    PictureKind.PREVIEW: PictureEncoding.JPEG,
    PictureKind.RAW: PictureEncoding.PNG,
    PictureKind.REASONS: PictureEncoding.ZSTD,
    PictureKind.CONFIDENCE: PictureEncoding.ZSTD,
}
_STEP = {PictureKind.REASONS: 4, PictureKind.CONFIDENCE: 4}


def picture_fragments(
    pixels: NDArray[np.uint8],
    *,
    kind: PictureKind,
    frame: int,
    timestamp_us: int,
    mtu: int,
    encoding: PictureEncoding | None = None,
    crop: tuple[int, int, int, int] | None = None,
    lens_position: int | None = None,
    quality: int = _QUALITY,
) -> Iterator[tuple[int, int, bytes]]:
    """Turn pixels (height, width[, 3]) uint8 into the packets of one message on `kind.channel`.

    Each is (flags, fragment index, payload of at most `mtu` bytes), as `fragment` gives them. Of reasons and confidence
    every 4th pixel both ways is sent. `encoding` None is the kind's own: JPEG of this `quality` for previews, PNG for raw
    frames, zstd for planes. `crop` is where the pixels lie in the whole; None: they are all of it. Raises WireError where the
    picture is beyond the limits.
    """
    step = _STEP.get(kind, 1)
    x, y = crop[:2] if crop else (0, 0)
    rows, columns = pixels.shape[:2]
    pixels = np.ascontiguousarray(pixels[::step, ::step])
    encoding = _ENCODING[kind] if encoding is None else encoding
    data = compress(pixels, encoding, quality)
    head = PictureHead(
        kind=kind,
        encoding=encoding,
        frame=frame & _FRAME,
        timestamp_us=timestamp_us,
        width=pixels.shape[1],
        height=pixels.shape[0],
        channels=1 if pixels.ndim == 2 else pixels.shape[2],
        crop=(x, y, columns, rows),
        step=step,
        size=len(data),
        lens_position=lens_position,
    )
    head.check()
    yield FIRST, 0, head.pack()
    room = mtu - _PREFIX.size
    for index, offset in enumerate(range(0, len(data), room), 1):
        flags = LAST if offset + room >= len(data) else 0
        yield flags, index, _PREFIX.pack(head.frame, offset) + data[offset : offset + room]


@dataclass(frozen=True, slots=True)
class ReceivedPicture:
    """A picture as it arrived: its head, and the bytes of a JPEG or PNG file, or of a zstd frame, that agree with it."""

    head: PictureHead
    data: bytes

    def pixels(self) -> NDArray[np.uint8]:
        """Decode it: (height, width[, 3]) uint8, colours in BGR order; raises WireError where the bytes are no such picture."""
        return decompress(self.head, self.data)


@dataclass(frozen=True, slots=True)
class PictureStatistics:
    """Pictures `whole` and `lost` (cut short by a lost packet or a newer one); packets `malformed` and `stray`."""

    whole: int = 0
    lost: int = 0
    malformed: int = 0
    stray: int = 0


class PictureAssembler:
    """Puts pictures together, one of each kind at a time; never raises, whatever the packets hold."""

    def __init__(self) -> None:
        self._open: dict[PictureKind, tuple[PictureHead, bytearray]] = {}
        self._whole = self._lost = self._malformed = self._stray = 0

    @property
    def statistics(self) -> PictureStatistics:
        """The counters so far."""
        return PictureStatistics(self._whole, self._lost, self._malformed, self._stray)

    def feed(self, packet: Packet) -> list[ReceivedPicture]:
        """Take one packet of a picture's channel and return the picture that it completes, if any."""
        try:
            if packet.flags & FIRST:
                self._start(packet)
                return []
            return self._continue(packet)
        except WireError:
            self._malformed += 1
            return []

    def _start(self, packet: Packet) -> None:
        head = PictureHead.unpack(packet.payload)
        if head.kind.channel != packet.channel:
            raise WireError(f"a picture of kind {head.kind} on channel {packet.channel}: it has {head.kind.channel}")
        opened = self._open.get(head.kind)
        if opened is not None and opened[0] == head:
            return  # the head was sent twice
        self._lost += opened is not None
        self._open[head.kind] = (head, bytearray())

    def _continue(self, packet: Packet) -> list[ReceivedPicture]:
        frame, offset = read_fields(_PREFIX, packet.payload, "a part of a picture")
        kind = next((kind for kind, (head, _) in self._open.items() if kind.channel == packet.channel), None)
        if kind is None or self._open[kind][0].frame != frame:
            self._stray += 1
            return []
        head, taken = self._open[kind]
        part = memoryview(packet.payload)[_PREFIX.size :]
        if offset < len(taken):
            return []  # this packet came twice
        if offset > len(taken) or offset + len(part) > head.size:
            del self._open[kind]
            self._lost += 1
            return []
        taken += part
        if len(taken) < head.size:
            return []
        del self._open[kind]
        data = bytes(taken)
        check_bytes(head, data)
        self._whole += 1
        return [ReceivedPicture(head, data)]
