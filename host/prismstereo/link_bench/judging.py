"""Holds what arrived against what was sent: every pixel of a row that is not marked as lost has to be right."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from prismstereo.link_bench.numbered_maps import DIFFERENT, numbered_map
from prismstereo_device.codec.baseline import rows_per_stripe
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.protocol import ReceivedFrame
from prismstereo_device.serving.rate_control import HALVED, halved

__all__ = ["FrameJudge", "Judgement", "lens_position_of"]

_LENS_POSITIONS = 251


def lens_position_of(number: int) -> int:
    """Give the lens position that is stamped on the frame of this number: a second thing to get wrong."""
    return number % _LENS_POSITIONS


@dataclass(frozen=True, slots=True)
class Judgement:
    """Of one frame: its stripes, those that arrived and are right, and those that arrived and are WRONG."""

    stripes: int
    right: int
    wrong: int


class FrameJudge:
    """Knows the maps of this size that the far end sends."""

    def __init__(self, width: int, height: int) -> None:
        self._width, self._height = width, height

    def judge(self, frame: ReceivedFrame) -> Judgement:
        """Count stripes; a frame whose head is wrong is wrong in every stripe."""
        small = bool(frame.filter_set & HALVED)
        sent, steps = _steps(frame.index % DIFFERENT, self._width, self._height, small=small)
        rows = rows_per_stripe(sent.disparity_px.shape[1])
        tops = range(0, sent.disparity_px.shape[0], rows)
        got = frame.disparity
        head_is_right = (
            got.disparity_px.shape == sent.disparity_px.shape
            and got.window == sent.window
            and frame.lens_position == lens_position_of(frame.index)
        )
        if not head_is_right:
            return Judgement(len(tops), 0, len(tops))
        lost = np.zeros(len(sent.disparity_px), np.bool_) if frame.lost_rows is None else frame.lost_rows
        row_is_right = _right_rows(steps, got, frame.bound)
        row_is_right[lost] = ~np.isfinite(got.disparity_px[lost]).any(axis=1)
        right = wrong = 0
        for top in tops:
            if not row_is_right[top : top + rows].all():
                wrong += 1
            elif not lost[top : top + rows].all():
                right += 1
        return Judgement(len(tops), right, wrong)


@lru_cache(maxsize=2 * DIFFERENT)
def _steps(number: int, width: int, height: int, *, small: bool) -> tuple[DisparityMap, NDArray[np.int32]]:
    """Give the map that was sent, and the same in sixteenths of a pixel, 0 where unmatched."""
    whole = numbered_map(number, width, height)
    sent = halved(whole) if small else whole
    return sent, sent.fixed_point().astype(np.int32)


def _right_rows(steps: NDArray[np.int32], got: DisparityMap, bound: int) -> NDArray[np.bool_]:
    """Say of each row whether the same pixels are matched and none is off by more than `bound` sixteenths."""
    received = got.fixed_point().astype(np.int32)
    right: NDArray[np.bool_] = (((steps == 0) == (received == 0)) & (np.abs(steps - received) <= bound)).all(axis=1)
    return right
