"""A frame whose stripes are still arriving, and what it is once it has ended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_device import codec
from prismstereo_device.codec import compact
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.protocol.fragments import TABLES, Piece
from prismstereo_device.protocol.frame_head import DisparityHead
from prismstereo_device.wire import LIMITS, WireError

__all__ = ["OpenFrame", "ReceivedFrame"]

_CODECS = (codec.CODEC, compact.CODEC)


@dataclass(frozen=True, slots=True)
class ReceivedFrame:
    """A frame as it arrived.

    `index` is the device's frame number modulo 2^32, `timestamp_us` the device's clock at mid-exposure,
    `calibration_hash` the first 4 bytes of the calibration's. Where stripes were lost, `partial` is set and their
    pixels are NaN: `lost_rows` (height,) bool says which. `bound` is the largest error of a matched pixel in sixteenths,
    `filter_set` numbers the filters that ran on the device.
    """

    index: int
    timestamp_us: int
    disparity: DisparityMap
    calibration_hash: bytes
    lens_position: int | None
    missing_stripes: int
    filter_set: int = 0
    bound: int = 0
    lost_rows: NDArray[np.bool_] | None = None

    @property
    def partial(self) -> bool:
        """Whether stripes were lost on the line."""
        return self.missing_stripes > 0


class OpenFrame:
    """Takes the stripes of one frame in any order, the pieces of one stripe in theirs; raises WireError for a codec unknown."""

    def __init__(self, head: DisparityHead) -> None:
        self._head = head
        if head.codec not in _CODECS:
            raise WireError(f"frame {head.frame} is in codec {head.codec}: known are {_CODECS}")
        if head.codec == codec.CODEC and (head.near or head.table or head.table_apart):
            raise WireError(f"frame {head.frame} is in codec 1 with a bound or tables: it has neither")
        self._tables: compact.Tables | None = None
        if head.codec == compact.CODEC and not head.table_apart:
            self._tables = compact.Tables.read(head.table, head.near)
        self._steps = np.zeros((head.height, head.width), np.uint16)
        self._seen = np.zeros(head.stripes, np.bool_)
        self._cut_stripe = -1
        self._cut_bytes = bytearray()
        self._taken_bytes = 0

    def add(self, piece: Piece) -> bool:
        """Take a stripe, or a piece of one, or of the tables; False: its tables were lost. Raises WireError."""
        if piece.stripe >= self._head.stripes and piece.stripe != TABLES:
            raise WireError(f"stripe {piece.stripe} of a frame that has {self._head.stripes}")
        self._taken_bytes += len(piece.data)
        if self._taken_bytes > LIMITS.message:
            raise WireError(f"frame {self._head.frame} has more than {LIMITS.message} bytes")
        if piece.whole:
            return self._take(piece.stripe, piece.data)
        if piece.offset == 0:
            self._cut_stripe = piece.stripe
            self._cut_bytes.clear()
        if piece.stripe != self._cut_stripe or piece.offset != len(self._cut_bytes):
            return True  # an earlier piece was lost, and the stripe with it
        self._cut_bytes += piece.data
        if len(self._cut_bytes) < piece.total:
            return True
        self._cut_stripe = -1
        return self._take(piece.stripe, bytes(self._cut_bytes))

    def _take(self, stripe: int, data: bytes) -> bool:
        if stripe == TABLES:
            self._read_tables(data)
            return True
        rows = self._head.rows_of(stripe)
        if self._head.codec == codec.CODEC:
            pixels = codec.decode_stripe(data, rows, self._head.width)
        elif self._tables is None:
            return False
        else:
            pixels = compact.decode_stripe(data, rows, self._head.width, self._head.near, self._tables)
        top = stripe * self._head.stripe_rows
        self._steps[top : top + rows] = pixels
        self._seen[stripe] = True
        return True

    def _read_tables(self, data: bytes) -> None:
        if len(data) != self._head.table_apart:
            raise WireError(f"tables of {len(data)} bytes in a frame that announces {self._head.table_apart}")
        if self._tables is None:  # else they were sent twice
            self._tables = compact.Tables.read(data, self._head.near)

    def finish(self) -> ReceivedFrame:
        """Give the frame as it is."""
        rows = np.repeat(~self._seen, self._head.stripe_rows)[: self._head.height]
        return ReceivedFrame(
            index=self._head.frame,
            timestamp_us=self._head.timestamp_us,
            disparity=DisparityMap.from_fixed_point(self._steps, self._head.window),
            calibration_hash=self._head.calibration_hash,
            lens_position=self._head.lens_position,
            missing_stripes=int(self._seen.size - np.count_nonzero(self._seen)),
            filter_set=self._head.filter_set,
            bound=self._head.near,
            lost_rows=rows,
        )
