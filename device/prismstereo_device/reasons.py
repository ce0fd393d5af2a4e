"""Why a pixel has no disparity. Never guessed where it can be known: the first three are known once per calibration."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Reason"]


class Reason(IntEnum):
    """What is said of a pixel, as one byte; the static ones have the numbers of a calibration's mask."""

    MATCHED = 0
    OUTSIDE = 1  # static: not in both views
    SEAM = 2  # static: both views lie over each other there
    VIGNETTED = 3  # static: next to no light comes there
    TOO_NEAR = 4  # nearer than the range
    TOO_FAR = 5
    OCCLUDED = 6  # the right view contradicts: something stands before it there
    WEAK_TEXTURE = 7
    AMBIGUOUS = 8  # another disparity explains the pictures as well
    SATURATED = 9
    DARK = 10
    FILTERED = 11  # matched, and taken away by a filter
    LOST_ON_LINE = 12
    UNMATCHED = 13  # none of the above is known
