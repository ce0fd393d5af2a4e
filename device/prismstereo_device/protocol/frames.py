"""Whole frames: a disparity map to packets on the camera, packets to a disparity map on the desk.

Video is never sent again. What is lost is delivered as unmatched pixels, and the frame says that it is `partial`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from prismstereo_device import codec
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.framing import Packet
from prismstereo_device.protocol.fragments import Piece, cut, read_fragment
from prismstereo_device.protocol.frame_head import DisparityHead
from prismstereo_device.wire import FIRST, LAST, LIMITS, WireError

__all__ = ["AssemblyStatistics", "FrameAssembler", "ReceivedFrame", "fragment"]

_STRIPE_DECODERS = {codec.CODEC: codec.decode_stripe}
_HASH_ON_FRAMES = 4  # bytes of the calibration's hash
_HALF_RANGE = 1 << 31
_FRAME = 0xFFFF_FFFF


def fragment(
    disparity: DisparityMap,
    *,
    frame: int,
    timestamp_us: int,
    calibration_hash: bytes,
    mtu: int,
    lens_position: int | None = None,
) -> Iterator[tuple[int, int, bytes]]:
    """Turn a map into the packets of one message: (flags, fragment index, payload of at most `mtu` bytes) each.

    `frame` counts modulo 2^32; `calibration_hash` may be longer than the 4 bytes that are sent. Raises WireError where
    the map is empty or too large.
    """
    steps = disparity.fixed_point()
    stripes = codec.encode(steps)
    height, width = steps.shape
    head = DisparityHead(
        frame=frame & _FRAME,
        timestamp_us=timestamp_us,
        width=width,
        height=height,
        codec=codec.CODEC,
        stripe_rows=codec.rows_per_stripe(width),
        stripes=len(stripes),
        calibration_hash=calibration_hash[:_HASH_ON_FRAMES],
        window=disparity.window,
        lens_position=lens_position,
    )
    waiting, index = head.pack(), 0
    for payload in cut(head.frame, stripes, mtu):
        yield (0 if index else FIRST), index, waiting
        waiting, index = payload, index + 1
    yield LAST, index, waiting


@dataclass(frozen=True, slots=True)
class ReceivedFrame:
    """A frame as it arrived.

    `index` is the device's frame number modulo 2^32, `timestamp_us` the device's clock at mid-exposure,
    `calibration_hash` the first 4 bytes of the calibration's. Where stripes were lost, `partial` is set and their
    pixels are NaN.
    """

    index: int
    timestamp_us: int
    disparity: DisparityMap
    calibration_hash: bytes
    lens_position: int | None
    missing_stripes: int

    @property
    def partial(self) -> bool:
        """Whether stripes were lost on the line."""
        return self.missing_stripes > 0


@dataclass(frozen=True, slots=True)
class AssemblyStatistics:
    """What could not be used: `malformed` packets, and `stray` ones of a frame whose head was not seen."""

    malformed: int = 0
    stray: int = 0


class _OpenFrame:
    """A frame whose stripes are still arriving."""

    def __init__(self, head: DisparityHead) -> None:
        self.head = head
        self._steps = np.zeros((head.height, head.width), np.uint16)
        self._seen = np.zeros(head.stripes, np.bool_)
        self._cut_stripe = -1
        self._cut_bytes = bytearray()
        self._taken_bytes = 0

    def add(self, piece: Piece) -> None:
        """Take a stripe, or a piece of one; raises WireError."""
        if piece.stripe >= self.head.stripes:
            raise WireError(f"stripe {piece.stripe} of a frame that has {self.head.stripes}")
        self._taken_bytes += len(piece.data)
        if self._taken_bytes > LIMITS.message:
            raise WireError(f"frame {self.head.frame} has more than {LIMITS.message} bytes")
        if piece.whole:
            self._decode(piece.stripe, piece.data)
            return
        if piece.offset == 0:
            self._cut_stripe = piece.stripe
            self._cut_bytes.clear()
        if piece.stripe != self._cut_stripe or piece.offset != len(self._cut_bytes):
            return  # an earlier piece was lost, and the stripe with it
        self._cut_bytes += piece.data
        if len(self._cut_bytes) >= piece.total:
            self._cut_stripe = -1
            self._decode(piece.stripe, bytes(self._cut_bytes))

    def _decode(self, stripe: int, data: bytes) -> None:
        rows = self.head.rows_of(stripe)
        top = stripe * self.head.stripe_rows
        self._steps[top : top + rows] = _STRIPE_DECODERS[self.head.codec](data, rows, self.head.width)
        self._seen[stripe] = True

    def finish(self) -> ReceivedFrame:
        """Give the frame as it is."""
        return ReceivedFrame(
            index=self.head.frame,
            timestamp_us=self.head.timestamp_us,
            disparity=DisparityMap.from_fixed_point(self._steps, self.head.window),
            calibration_hash=self.head.calibration_hash,
            lens_position=self.head.lens_position,
            missing_stripes=int(self._seen.size - np.count_nonzero(self._seen)),
        )


class FrameAssembler:
    """Puts the frames of one session together; never raises, whatever the packets hold.

    A frame is finished by its last fragment, by the start of a newer frame, or when too many are open.
    """

    def __init__(self) -> None:
        self._open: dict[int, _OpenFrame] = {}
        self._newest_started: int | None = None
        self._malformed = 0
        self._stray = 0

    @property
    def newest_started(self) -> int | None:
        """Number of the newest frame whose head was seen; None before the first."""
        return self._newest_started

    @property
    def statistics(self) -> AssemblyStatistics:
        """The counters so far."""
        return AssemblyStatistics(self._malformed, self._stray)

    def feed(self, packet: Packet) -> list[ReceivedFrame]:
        """Take one packet of the disparity channel and return the frames that it finishes, oldest first."""
        try:
            if packet.flags & FIRST:
                return self._start(packet)
            return self._continue(packet)
        except WireError:
            self._malformed += 1
            return []

    def flush(self) -> list[ReceivedFrame]:
        """Finish every open frame, oldest first: the stream has ended."""
        frames = [opened.finish() for opened in self._open.values()]
        self._open.clear()
        return frames

    def _start(self, packet: Packet) -> list[ReceivedFrame]:
        head = DisparityHead.unpack(packet.payload)
        if head.codec not in _STRIPE_DECODERS:
            raise WireError(f"frame {head.frame} is in codec {head.codec}: known are {sorted(_STRIPE_DECODERS)}")
        if head.frame in self._open:  # the head was sent twice, or the whole frame again
            return []
        newest = self._newest_started
        finished = []
        if newest is None or 0 < (head.frame - newest) & _FRAME < _HALF_RANGE:
            finished = self.flush()
            self._newest_started = head.frame
        elif len(self._open) >= LIMITS.frames_in_assembly:
            finished = [self._open.pop(next(iter(self._open))).finish()]
        self._open[head.frame] = _OpenFrame(head)
        return finished + self._end(head.frame, packet)

    def _continue(self, packet: Packet) -> list[ReceivedFrame]:
        pieces = read_fragment(packet.payload)
        if not pieces or pieces[0].frame not in self._open:
            self._stray += 1
            return []
        frame = pieces[0].frame
        for piece in pieces:
            try:
                self._open[frame].add(piece)
            except WireError:
                self._malformed += 1
        return self._end(frame, packet)

    def _end(self, frame: int, packet: Packet) -> list[ReceivedFrame]:
        return [self._open.pop(frame).finish()] if packet.flags & LAST else []
