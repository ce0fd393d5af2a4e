"""Bytes in, damaged bytes out: what a bad line does to a stream in one direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo.link_bench.fault_plan import Faults

__all__ = ["Damage"]

_MOST_GARBAGE = 400  # bytes

Bytes = NDArray[np.uint8]


class Damage:
    """Damages a stream by a seed: the same bytes are flipped, lost or doubled however the stream is chopped into calls."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults = faults
        self._where = [np.random.default_rng([seed, kind]) for kind in range(6)]  # apart, so that none shifts another
        self._what = [np.random.default_rng([seed, 100 + kind]) for kind in range(6)]

    def apply(self, data: bytes, now_s: float) -> bytes:
        """Give what comes out at the other end, so many seconds after the line was set up."""
        faults = self._faults
        if faults.cut is not None and faults.cut.active(now_s):
            return b""
        if faults.chunkdrop and self._where[4].random() < faults.chunkdrop:
            return b""
        stream = np.frombuffer(data, np.uint8)
        if faults.baud is not None and faults.baud.active(now_s):
            return self._what[5].integers(0, 256, stream.size).astype(np.uint8).tobytes()
        for share, step in (
            (faults.flips, self._flip),
            (faults.bits, self._turn_bits),
            (faults.drops, self._drop),
            (faults.dups, self._double),
        ):
            if share:
                stream = step(stream, share)
        return stream.tobytes() + self._garbage(faults.garbage)

    def _flip(self, stream: Bytes, share: float) -> Bytes:
        hit = np.flatnonzero(self._where[0].random(stream.size) < share)
        changed = stream.copy()
        changed[hit] ^= self._what[0].integers(1, 256, hit.size).astype(np.uint8)
        return changed

    def _turn_bits(self, stream: Bytes, share: float) -> Bytes:
        turned = self._where[1].random(8 * stream.size) < share
        return stream ^ np.packbits(turned)

    def _drop(self, stream: Bytes, share: float) -> Bytes:
        kept: Bytes = stream[self._where[2].random(stream.size) >= share]
        return kept

    def _double(self, stream: Bytes, share: float) -> Bytes:
        return np.repeat(stream, 1 + (self._where[3].random(stream.size) < share))

    def _garbage(self, share: float) -> bytes:
        if not share or self._where[5].random() >= share:
            return b""
        return self._what[4].bytes(int(self._what[4].integers(1, _MOST_GARBAGE + 1)))
