"""The size of the raw frame from the sizes of the views cut out of it."""

from __future__ import annotations

import math

from prismstereo_calibration.convert.pair import StereoPairModel
from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.errors import UsageError
from prismstereo_hw.view import View

__all__ = ["frame_size"]


def frame_size(
    pair: StereoPairModel,
    views: tuple[View, View],
    likely: tuple[int, int] | None = None,
    asked: tuple[int, int] | None = None,
) -> tuple[int, int]:
    """Return width and height of the frame whose views have the pair's sizes; a likely one is tried first.

    Where a file tells no size, it is the one asked for, or the likely one, `UsageError` without; `CalibrationError` when
    no frame, or not the one asked for, has such views.
    """
    sizes = pair.left.size, pair.right.size
    if sizes[0] is None or sizes[1] is None:
        best = asked or likely
        if best is None:
            raise UsageError("these files do not tell the size of the pictures: give the raw frame's with --frame-px")
        return best
    known = sizes[0], sizes[1]
    for first in (asked, likely):
        if first is not None and _sizes(views, *first) == known:
            return first
    view, (w, h) = views[0], known[0]
    across, down = (h, w) if view.turn_deg in (90, 270) else (w, h)
    widths = _around(across / view.width, 1 / view.width)
    heights = _around(down * view.row_step / view.height, view.row_step / view.height)
    found = [(width, height) for width in widths for height in heights if _sizes(views, width, height) == known]
    if not found or asked is not None:
        wanted = "one frame here" if asked is None else f"a frame of {asked[0]}x{asked[1]}"
        raise CalibrationError(
            f"pictures of {known[0][0]}x{known[0][1]} and {known[1][0]}x{known[1][1]} px are no views of {wanted}: "
            "give the rig or the layout of the unit, and files of the same mode"
        )
    return found[0]


def _sizes(views: tuple[View, View], width: int, height: int) -> tuple[tuple[int, int], tuple[int, int]]:
    return views[0].upright_size(width, height), views[1].upright_size(width, height)


def _around(value: float, reach: float) -> list[int]:
    """Return the whole numbers within so far of a value, nearest first."""
    numbers = range(max(1, math.floor(value - reach)), math.ceil(value + reach) + 1)
    return sorted(numbers, key=lambda number: abs(number - value))
