"""The calibration that a camera's frames were made with: fetched when it is first needed, and again when it changes."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import TYPE_CHECKING

from prismstereo.transfer import ObjectTransfer
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.protocol import ReceivedFrame, calibration_hash
from prismstereo_device.wire import LIMITS
from prismstereo_hw.errors import DataError

if TYPE_CHECKING:
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.rectification import Rectification
    from prismstereo_calibration.window import DisparityWindow

__all__ = ["HeldCalibration"]

_SAME = 1e-6  # windows travel as 32-bit floats
_JUST_WITHIN = 1.0005  # the near end is a border: rounding may not push it out


class HeldCalibration:
    """The calibration last needed, under its hash, and what is made of it; never that of another. For any thread."""

    def __init__(self, transfer: ObjectTransfer, name: str) -> None:
        self._transfer = transfer
        self._name = name
        self._changing = threading.RLock()
        self._content = b""
        self._calibration: Calibration | None = None
        self._own: Rectification | None = None
        self._windows: dict[DisparityWindow, DisparityWindow] = {}
        self._geometries: dict[tuple[DisparityWindow, int, int], Rectification] = {}

    def content(self, named: bytes) -> bytes:
        """Give the flash bytes whose hash begins with `named` (4 or 8 bytes), fetched unless they are held.

        Raises LinkLost when the camera does not answer, DataError when it holds no calibration, or another one.
        """
        if not any(named):
            raise DataError(f"the sensor on {self._name} holds no calibration: calibrate it, then flash it")
        with self._changing:
            return self._fetched(named)

    def _fetched(self, named: bytes) -> bytes:
        if not calibration_hash(self._content).startswith(named):
            content = self._transfer.read(ObjectNumber.CALIBRATION, LIMITS.calibration)
            found = calibration_hash(content)
            if not found.startswith(named):
                raise DataError(
                    f"the calibration on {self._name} has hash {found.hex()}, asked for was {named.hex()}: "
                    "it was replaced meanwhile; take a newer frame, or open the sensor again"
                )
            self._content, self._calibration, self._own = content, None, None
            self._windows.clear()
            self._geometries.clear()
        return self._content

    def calibration(self, named: bytes) -> Calibration:
        """Give the calibration whose hash begins with `named`; raises as `content`, or CalibrationError."""
        from prismstereo_calibration import flash

        with self._changing:
            content = self.content(named)
            if self._calibration is None:
                self._calibration = flash.unpack(content)
            return self._calibration

    def window(self, frame: ReceivedFrame) -> DisparityWindow:
        """Give the window that makes depth of a frame: its own, with what glass before the lens does to its disparities.

        A frame of half the resolution had the glass taken off on the camera, and its window says its smaller scale. Raises
        as `calibration`.
        """
        own = frame.disparity.window
        if not any(frame.calibration_hash):
            return own
        with self._changing:
            calibration = self.calibration(frame.calibration_hash)
            if calibration.left.plate is None:
                return own
            if own not in self._windows:
                self._windows[own] = _with_glass(calibration, self._own_rectification(calibration), own)
            window = self._windows[own]
        glass = window.glass
        fits = glass is not None and frame.disparity.disparity_px.shape == (glass.height, glass.width)
        return window if fits else own

    def rectification(self, frame: ReceivedFrame) -> Rectification:
        """Give the geometry of a frame's map: focal length and principal points in its own pixels, and its own window.

        Raises as `calibration`; DataError where the map is not one that this calibration makes.
        """
        height, width = frame.disparity.disparity_px.shape
        key = frame.disparity.window, width, height
        with self._changing:
            calibration = self.calibration(frame.calibration_hash)
            if key not in self._geometries:
                found = _geometry(calibration, self._own_rectification(calibration), frame.disparity.window)
                if (found.width, found.height) != (width, height):
                    raise DataError(
                        f"frame {frame.index} from {self._name} has {width}x{height} pixels, its calibration makes "
                        f"{found.width}x{found.height} of its range: it belongs to another calibration"
                    )
                self._geometries[key] = found
            return self._geometries[key]

    def _own_rectification(self, calibration: Calibration) -> Rectification:
        """Derive it once: with glass it takes a while."""
        from prismstereo_calibration.rectification import rectification

        if self._own is None:
            self._own = rectification(calibration)
        return self._own


def _geometry(calibration: Calibration, own: Rectification, window: DisparityWindow) -> Rectification:
    """Derive the geometry of maps with a window; one of a smaller picture has a smaller scale."""
    from prismstereo_calibration.rectification import rectification
    from prismstereo_hw.rig import RangeWish

    factor = max(1, round(own.window.scale_px / window.scale_px)) if window.scale_px > 0 else 1
    if factor > 1:  # maps are made smaller on the camera from those of its own range
        return replace(_smaller(own, factor), window=window)
    if own.window.labels == window.labels and _near(own.window, window):
        return own
    wish = RangeWish(near_mm=window.nearest * _JUST_WITHIN, far_mm=window.farthest, labels=window.labels)
    return rectification(calibration, wish, window.labels)


def _smaller(large: Rectification, factor: int) -> Rectification:
    """Give the geometry of maps that hold one pixel for each block of `factor` x `factor`, cut blocks included."""
    middle = (factor - 1) / 2
    return replace(
        large,
        left=replace(large.left, cx_px=(large.left.cx_px - middle) / factor),
        right=replace(large.right, cx_px=(large.right.cx_px - middle) / factor),
        focal_px=large.focal_px / factor,
        cy_px=(large.cy_px - middle) / factor,
        width=-(-large.width // factor),
        height=-(-large.height // factor),
    )


def _with_glass(calibration: Calibration, own: Rectification, window: DisparityWindow) -> DisparityWindow:
    from prismstereo_calibration.rectification import rectification
    from prismstereo_hw.rig import RangeWish

    if own.window.labels == window.labels and _near(own.window, window):
        return replace(window, glass=own.window.glass)
    if abs(window.scale_px / own.window.scale_px - 1) > _SAME:
        return window  # of a smaller picture
    wish = RangeWish(near_mm=window.nearest * _JUST_WITHIN, far_mm=window.farthest, labels=window.labels)
    return replace(window, glass=rectification(calibration, wish, window.labels).window.glass)


def _near(one: DisparityWindow, other: DisparityWindow) -> bool:
    return abs(one.offset_px - other.offset_px) < _SAME * max(1.0, abs(one.offset_px)) and (
        abs(other.scale_px / one.scale_px - 1) < _SAME
    )
