"""What is known about each pixel of a map at still resolution, as bits of one byte."""

from __future__ import annotations

from enum import IntFlag

__all__ = ["Flag"]


class Flag(IntFlag):
    """How a pixel of an upsampled map came about; several may hold at once."""

    FLAT = 1  # among sites of one surface: interpolated
    BAND = 2  # at a depth edge: the guide decided which surface it belongs to
    FILLED = 4  # rests on a site that the matcher left empty
    NO_LOW_RESOLUTION = 8  # the video never saw it: no disparity
    GUIDE_IS_VIDEO = 16  # no still could be trusted here: the enlarged video frame was the guide
    MOVED = 32  # the still was warped here to follow an object
    RIGHT = 64  # in the band: comes from a right site of its cell of four, not a left one
    LOWER = 128  # in the band: comes from a lower site of its cell, not an upper one
