"""Whole frames on their way out: a disparity map to packets, exact or within a bound."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from prismstereo_device import codec
from prismstereo_device.codec import compact
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.protocol.fragments import TABLES, cut
from prismstereo_device.protocol.frame_head import HEAD_SIZE, DisparityHead
from prismstereo_device.wire import FIRST, LAST, LIMITS

__all__ = ["fragment"]

_HASH_ON_FRAMES = 4  # bytes of the calibration's hash
_FRAME = 0xFFFF_FFFF
_WORTH = 15 / 16  # what frozen tables cost, on most maps, is less than a packet whose loss would cost the whole frame


def fragment(
    disparity: DisparityMap,
    *,
    frame: int,
    timestamp_us: int,
    calibration_hash: bytes,
    mtu: int,
    lens_position: int | None = None,
    filter_set: int = 0,
    bound: int | None = None,
    lossy: bool = False,
) -> Iterator[tuple[int, int, bytes]]:
    """Turn a map into the packets of one message: (flags, fragment index, payload of at most `mtu` bytes) each.

    With `bound` None it is coded by codec 1, exact; with 0, 1, 2 or 4 by codec 2, and no matched pixel moves by more than
    that many sixteenths. The first packet is the head; it may be written twice, and with `lossy` the stripes need nothing
    beside it. `frame` counts modulo 2^32; `calibration_hash` may be longer than the 4 bytes that are sent. Raises WireError
    where the map is empty or too large, UsageError for another bound.
    """
    steps = disparity.fixed_point()
    table, stripes = _encoded(steps, bound, mtu, lossy=lossy)
    beside = len(table) <= mtu - HEAD_SIZE
    height, width = steps.shape
    head = DisparityHead(
        frame=frame & _FRAME,
        timestamp_us=timestamp_us,
        width=width,
        height=height,
        codec=codec.CODEC if bound is None else compact.CODEC,
        stripe_rows=codec.rows_per_stripe(width),
        stripes=len(stripes),
        calibration_hash=calibration_hash[:_HASH_ON_FRAMES],
        window=disparity.window,
        lens_position=lens_position,
        filter_set=filter_set,
        near=bound or 0,
        table=table if beside else b"",
        table_apart=0 if beside else len(table),
    )
    waiting, index = head.pack(), 0
    for payload in _payloads(head, table, stripes, mtu):
        yield (0 if index else FIRST), index, waiting
        waiting, index = payload, index + 1
    yield LAST, index, waiting


def _payloads(head: DisparityHead, table: bytes, stripes: Sequence[bytes], mtu: int) -> Iterator[bytes]:
    if head.table_apart:
        yield from cut(head.frame, [table], mtu, first=TABLES)
    yield from cut(head.frame, stripes, mtu)


def _encoded(steps: NDArray[np.uint16], bound: int | None, mtu: int, *, lossy: bool) -> tuple[bytes, Sequence[bytes]]:
    """Give the tables and the stripes of a map.

    Tables that need packets of their own, and with them the frame, are lost more often than tables beside the head; so
    there the frozen ones are taken, unless they cost more than a sixteenth and the line is good.
    """
    if bound is None:
        return b"", codec.encode(steps)
    own = compact.encode_stripes(steps, bound)
    if len(own.tables) > mtu - HEAD_SIZE:
        frozen = compact.encode_stripes(steps, bound, compact.Tables.frozen(bound))
        if lossy or len(own.tables) > LIMITS.table or own.size > _WORTH * frozen.size:
            own = frozen
    return own.tables, own.stripes
