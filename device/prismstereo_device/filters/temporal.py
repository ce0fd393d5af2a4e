"""Temporal filter: levels the noise of what stands still, and begins anew where something moves."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.filters.depth_edge import DepthEdge
from prismstereo_device.filters.filter import Stage
from prismstereo_device.filters.filter_kernels import renew
from prismstereo_device.filters.sheet import Sheet

__all__ = ["Temporal"]

_USUAL_FRAME_US = 33_333  # between maps of which nobody told the time
_MOTION_WINDOW_PX = 5


class Temporal(DepthEdge, frozen=True, kw_only=True, tag="temporal"):
    """Give each match the mean of its pixel over time: the last maps count most, those `time_constant_ms` ago 1/e of that.

    The mean begins anew where the disparity jumps (a depth edge in time), where there was no match, and where the picture
    changed by more than `motion_grey` levels on average over 5x5 pixels; everywhere when the maps pause for `forget_ms`.
    """

    time_constant_ms: Annotated[float, Meta(gt=0, le=60_000)] = 100.0
    motion_grey: Annotated[float, Meta(gt=0, le=255)] = 8.0
    forget_ms: Annotated[float, Meta(gt=0, le=600_000)] = 500.0

    def stage(self) -> Stage:
        """Make the stage of one stream, which remembers the means so far."""
        return _Memory(self).apply


class _Memory:
    """The means of one stream so far: pixels and counted maps, and of what window, picture and time."""

    def __init__(self, settings: Temporal) -> None:
        self._settings = settings
        self._mean: NDArray[np.float32] = np.empty((0, 0), np.float32)
        self._ages: NDArray[np.uint8] = np.empty((0, 0), np.uint8)
        self._window: DisparityWindow | None = None
        self._picture: NDArray[np.uint8] | None = None
        self._time_us: int | None = None

    def apply(self, sheet: Sheet) -> Sheet:
        """Take a map in, and give its matches the means."""
        elapsed_us = self._elapsed_us(sheet.time_us)
        if self._mean.shape != sheet.disparity_px.shape or self._window != sheet.window or self._long(elapsed_us):
            self._mean = sheet.disparity_px.copy()
            self._ages = np.ones(self._mean.shape, np.uint8)
        else:
            weight = -math.expm1(-elapsed_us / (1000 * self._settings.time_constant_ms))
            reach = self._settings.reach(sheet.window)
            moved = self._moved(sheet.picture, sheet.disparity_px.shape)
            renew(sheet.disparity_px, moved, np.float32(weight), *reach, self._mean, self._ages)
        self._window, self._time_us = sheet.window, sheet.time_us
        self._picture = None if sheet.picture is None else sheet.picture.copy()  # a camera may use its buffer again
        return replace(sheet, disparity_px=self._mean.copy())

    def _elapsed_us(self, time_us: int | None) -> float:
        if time_us is None or self._time_us is None:
            return _USUAL_FRAME_US
        return time_us - self._time_us

    def _long(self, elapsed_us: float) -> bool:
        """Tell whether the last map is of no use any more: long ago, or of a clock that has begun anew."""
        return not 0 <= elapsed_us <= 1000 * self._settings.forget_ms

    def _moved(self, picture: NDArray[np.uint8] | None, shape: tuple[int, ...]) -> NDArray[np.uint8]:
        if picture is None or self._picture is None:
            return np.zeros(shape, np.uint8)
        change = cv2.blur(cv2.absdiff(picture, self._picture), (_MOTION_WINDOW_PX, _MOTION_WINDOW_PX))
        return np.asarray(change > self._settings.motion_grey, np.bool_).view(np.uint8)
