"""How one frame's pixels become points: the rectified left pinhole at the size of the frame's own disparity map.

A camera on a slow line sends maps of half the resolution, and one that was started for another range has other principal
columns; both are found here from the map's window and size, so that no exporter has to know of it.

Frame: rectified left optical, x right, y down, z forward, in the calibration's unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.rig import RangeWish

__all__ = ["FrameGeometry", "Geometries"]

_MOST_DECIMATED = 8
_SAME = 1e-6  # windows travel as 32-bit floats
_JUST_WITHIN = 1.0005  # the near end is a border: rounding may not push it out


@dataclass(frozen=True, slots=True)
class FrameGeometry:
    """Pinhole numbers of a rectified pair of `width` x `height` pixels, and the window that its disparities stand in.

    depth = focal_px * baseline / (disparity + offset_px), and `cx_right_px - cx_px` is that offset. The baseline is in
    `unit`. `decimated`: how many pixels of the calibrated picture one of these is wide. `window` knows of glass.
    """

    width: int
    height: int
    focal_px: float
    cx_px: float
    cy_px: float
    baseline: float
    unit: str
    window: DisparityWindow
    calibration: Calibration
    decimated: int = 1

    @property
    def offset_px(self) -> float:
        """What is added to a disparity before depth is made of it."""
        return self.window.offset_px

    @property
    def cx_right_px(self) -> float:
        """Principal column of the right picture."""
        return self.cx_px + self.window.offset_px

    @property
    def baseline_m(self) -> float:
        """The baseline in metres; UsageError where nobody said how large the board's squares were."""
        return self.baseline * self.metres

    @property
    def metres(self) -> float:
        """How many metres a unit has; UsageError where nobody said how large the board's squares were."""
        if self.unit != "mm":
            raise UsageError(
                "this calibration counts in squares of a board that nobody measured, so nothing is known in metres: "
                "calibrate with --square-mm"
            )
        return 1e-3

    def points(self, depth: NDArray[np.float32]) -> NDArray[np.float64]:
        """Take depths (height, width) to points (height, width, 3) of the left optical frame, in the depths' unit."""
        columns, rows = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        x = (columns - self.cx_px) / self.focal_px * depth
        y = (rows - self.cy_px) / self.focal_px * depth
        return np.stack([x, y, depth.astype(np.float64)], axis=-1)


class Geometries:
    """Finds the geometry of one calibration's frames, whatever their window and size; each is made once."""

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        self._made: dict[tuple[DisparityWindow, tuple[int, ...]], FrameGeometry] = {}
        self._own = rectification(calibration)

    def of(self, disparity: DisparityMap) -> FrameGeometry:
        """Give a map's geometry; DataError where the map is of no size or scale that the calibration makes."""
        key = disparity.window, disparity.disparity_px.shape
        if key not in self._made:
            self._made[key] = self._find(disparity.window, disparity.disparity_px.shape)
        return self._made[key]

    def _find(self, window: DisparityWindow, shape: tuple[int, ...]) -> FrameGeometry:
        height, width = shape
        own = self._own
        for factor in range(1, _MOST_DECIMATED + 1):
            fits = (height, width) == (-(-own.height // factor), -(-own.width // factor))
            if fits and abs(window.scale_px * factor / own.window.scale_px - 1) < _SAME:
                return self._decimated(window, factor, width, height)
        raise DataError(
            f"a frame of {width}x{height} pixels and {window.scale_px:g} px times unit is none of this calibration's, "
            f"{own.width}x{own.height} and {own.window.scale_px:g}: give the calibration that it was made with"
        )

    def _decimated(self, window: DisparityWindow, factor: int, width: int, height: int) -> FrameGeometry:
        made = self._rectified(window, factor)
        focal_px = made.focal_px / factor
        return FrameGeometry(
            width=width,
            height=height,
            focal_px=focal_px,
            cx_px=(made.left.cx_px + 0.5) / factor - 0.5,
            cy_px=(made.cy_px + 0.5) / factor - 0.5,
            baseline=window.scale_px / focal_px,
            unit=made.unit,
            window=replace(window, glass=made.window.glass) if factor == 1 else window,
            calibration=self.calibration,
            decimated=factor,
        )

    def _rectified(self, window: DisparityWindow, factor: int) -> Rectification:
        """Give the rectification that a window belongs to: the calibration's own, or the one for another range."""
        offset, own = window.offset_px * factor, self._own.window
        if abs(offset - own.offset_px) < _SAME * max(1.0, abs(offset)) and (factor > 1 or window.labels == own.labels):
            return self._own
        labels = window.labels if factor == 1 else own.labels
        wide = DisparityWindow(labels, offset, own.scale_px)
        wish = RangeWish(near_mm=wide.nearest * _JUST_WITHIN, far_mm=wide.farthest, labels=labels)
        return rectification(self.calibration, wish, labels)
