"""What every matcher can be asked for."""

from __future__ import annotations

from dataclasses import dataclass

from prismstereo_hw.errors import UsageError

__all__ = ["MatchSettings"]

_MOST_BITS = 8
_MOST_THREADS = 64
_MOST_LABELS = 1024


@dataclass(frozen=True, slots=True)
class MatchSettings:
    """Settings that all matchers share; `UsageError` for a setting that none can honour.

    `first_px`: the smallest disparity that is searched; the largest is that of the pair's window. `region`: x, y, width, height
    of the left rectified picture, beyond which nothing is matched; None for all of it. `subpixel_bits`: fractions of a pixel in
    a disparity, 0 for whole pixels. `threads`: how many work at once; the result does not depend on it.
    """

    first_px: int = 0
    region: tuple[int, int, int, int] | None = None
    subpixel_bits: int = 4
    threads: int = 2

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if not 0 <= self.first_px < _MOST_LABELS:
            raise UsageError(f"the first disparity is {self.first_px}: give 0 to {_MOST_LABELS - 1} pixels")
        if self.region is not None and not (min(self.region[:2]) >= 0 and min(self.region[2:]) > 0):
            raise UsageError(f"region {self.region}: give x, y, width, height in pixels, width and height above 0")
        if not 0 <= self.subpixel_bits <= _MOST_BITS:
            raise UsageError(f"{self.subpixel_bits} sub-pixel bits: give 0 (whole pixels) to {_MOST_BITS}")
        if not 1 <= self.threads <= _MOST_THREADS:
            raise UsageError(f"{self.threads} threads: give 1 to {_MOST_THREADS}")
