"""Numbers of a few bits in a row of bytes, the highest bit first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.wire import WireError

__all__ = ["BitReader", "BitWriter", "golomb_bits"]

_LOW_BITS = 2  # of a Golomb code
_MOST_ONES = 24  # no number that is sent has as many


def golomb_bits(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Count the bits of each number's Golomb code."""
    return (numbers >> _LOW_BITS) + 1 + _LOW_BITS


class BitWriter:
    """Collects bits."""

    def __init__(self) -> None:
        self._bits: list[str] = []
        self.size = 0

    def put(self, number: int, bits: int) -> None:
        """Append the `bits` lowest bits of a number."""
        self._bits.append(format(number, f"0{bits}b"))
        self.size += bits

    def put_golomb(self, number: int) -> None:
        """Append number // 4 ones, a zero, and two bits of remainder."""
        self.put((1 << ((number >> _LOW_BITS) + 1)) - 2, (number >> _LOW_BITS) + 1)
        self.put(number & ((1 << _LOW_BITS) - 1), _LOW_BITS)

    def finish(self) -> bytes:
        """Give the bytes, filled up with zeros."""
        text = "".join(self._bits)
        size = -(-self.size // 8)
        return int(text.ljust(8 * size, "0"), 2).to_bytes(size, "big") if size else b""


class BitReader:
    """Gives bits back; raises WireError where there are no more."""

    def __init__(self, data: bytes) -> None:
        self._text = format(int.from_bytes(data, "big"), f"0{8 * len(data)}b")
        self._at = 0

    def take(self, bits: int) -> int:
        """Give the next `bits` bits as a number."""
        piece = self._text[self._at : self._at + bits]
        if len(piece) < bits:
            raise WireError(f"tables of {len(self._text) // 8} bytes end within a number")
        self._at += bits
        return int(piece, 2)

    def take_golomb(self) -> int:
        """Give the next number that `put_golomb` wrote."""
        ones = 0
        while self.take(1):
            ones += 1
            if ones > _MOST_ONES:
                raise WireError(f"tables with more than {_MOST_ONES} ones in a row")
        return ones << _LOW_BITS | self.take(_LOW_BITS)

    def finish(self) -> None:
        """Raise WireError where more is left than fills up the last byte with zeros."""
        rest = self._text[self._at :]
        if len(rest) >= 8 or "1" in rest:
            raise WireError(f"tables with {len(rest)} bits too many")
