"""Disparity that the camera's own stereo engine computes, as a source of frames: it takes the place of sensor and pipeline.

The rectification is ours, sampled into a mesh that the camera warps by, so its disparities mean what ours mean: the window, its
offset, and what glass takes away come from our calibration. Only the search is the engine's: 96 or 192 labels.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration import flash
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.sensors.base import Exposure
from prismstereo_device.sensors.oak.control import CameraControls, control_limits
from prismstereo_device.sensors.oak.frame_queue import FrameQueue
from prismstereo_device.sensors.oak.frame_reading import picture, timestamp_us
from prismstereo_device.sensors.oak.graph import StereoPorts
from prismstereo_device.sensors.oak.mesh import ViewMesh
from prismstereo_device.sensors.oak.opening import Running
from prismstereo_device.sensors.oak.options import OakOptions
from prismstereo_device.sensors.oak.stereo_settings import StereoSettings
from prismstereo_device.sensors.oak.thinning import Thinning
from prismstereo_device.source import ProducedFrame
from prismstereo_hw.errors import DeviceError, ImageError
from prismstereo_hw.rig import RangeWish

__all__ = ["OakStereoSource", "StereoPlan"]

_RIM = 7  # the engine's matching window reaches over the rim of a view: half of it is not seen
_OTHER_MAPS_WAIT = 8  # confidence maps and pictures that are older than the disparity are passed over


@dataclass(frozen=True, slots=True)
class StereoPlan:
    """What the camera is to compute: the rectification for as many labels as it searches, and the meshes of its views."""

    calibration: Calibration
    made: Rectification
    meshes: tuple[ViewMesh, ViewMesh]
    settings: StereoSettings

    @classmethod
    def of(cls, calibration: Calibration, options: OakOptions, wish: RangeWish | None = None) -> StereoPlan:
        """Plan for a calibration and its range, whose near end is where the engine's labels end; or for a wished range.

        `UsageError` where the engine's labels do not reach a wished range.
        `CalibrationError` where frames of the options' size, or with the lens where they lock it, are not the calibrated ones.
        """
        size = calibration.frame_width, calibration.frame_height
        if size != (options.width, options.height):
            raise CalibrationError(
                f"the camera is to give {options.width}x{options.height}, but the calibration of {calibration.rig!r} is for "
                f"{size[0]}x{size[1]}: give width={size[0]}&height={size[1]}, or calibrate this mode"
            )
        labels = options.stereo.labels
        if wish is None:
            made = rectification(replace(calibration, range=msgspec.structs.replace(calibration.range, labels=labels)))
        else:
            made = rectification(calibration, wish, labels)
        return cls(calibration, made, (ViewMesh.of(made, made.left), ViewMesh.of(made, made.right)), options.stereo)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the rectified pictures."""
        return self.made.width, self.made.height

    def require_camera(self, platform: str, focus: int | None) -> None:
        """Refuse a camera that cannot do this, or whose lens stands elsewhere."""
        self.settings.require_platform(platform)
        self.settings.require_picture(*self.size, platform)
        calibrated = self.calibration.lens_position
        if None not in (focus, calibrated) and focus != calibrated:
            raise CalibrationError(
                f"the lens is locked at {focus}, but the calibration of {self.calibration.rig!r} is for {calibrated}: give "
                f"lens={calibrated}, or calibrate again"
            )

    def seen(self) -> NDArray[np.bool_]:
        """Return where the left view shows anything, (height, width), a matching window's half from its rim."""
        shown = np.isfinite(self.made.sources(self.made.left)[..., 0]).astype(np.uint8)
        return cv2.erode(shown, np.ones((_RIM, _RIM), np.uint8), borderValue=1).astype(bool)


class OakStereoSource:
    """Reads disparity off the camera. `begin` opens it and starts the stereo graph, again whenever it went away."""

    def __init__(
        self,
        dai: ModuleType,
        begin: Callable[[], Running[StereoPorts]],
        options: OakOptions,
        plan: StereoPlan,
        *,
        frames: int | None = None,
        patience_s: float = 30.0,
        silent_s: float = 5.0,
    ) -> None:
        self._dai, self._plan, self._left = dai, plan, frames
        self._seen, self._hash = plan.seen(), flash.digest(flash.pack(plan.calibration))
        self._thinning = Thinning(options.rate_hz)
        self._queue = FrameQueue(dai, begin, lambda ports: ports.disparity, patience_s=patience_s, silent_s=silent_s)
        self.modes = self._queue.running.camera.modes
        self.limits = control_limits(options.rate_hz, has_motor=False)  # focus is the calibration's
        self._controls = CameraControls(dai, self.limits, lambda: self._queue.running.ports.control)

    @property
    def temperature_c(self) -> float | None:
        """The chip's temperature; None where it does not tell."""
        return self._queue.running.chip_c()

    def set_exposure(self, exposure: Exposure) -> None:
        """Expose so from one of the next frames on; `UsageError` beyond the limits."""
        self._controls.set_exposure(exposure)

    def set_rate(self, rate_hz: float) -> None:
        """Give at most so many frames a second."""
        self._thinning = Thinning(rate_hz)

    def read(self) -> ProducedFrame | None:
        """Wait for the next disparity map; None after the last. `DeviceError` when the camera does not come back."""
        while self._left is None or self._left > 0:
            message, index = self._queue.next(self._controls.again)
            time_us = timestamp_us(self._dai, message)
            if not self._thinning.keeps(time_us):
                continue
            self._controls.notice(message)
            if self._left is not None:
                self._left -= 1
            running = self._queue.running
            return ProducedFrame(
                index,
                time_us,
                running.camera.focus if running.camera.has_motor else None,
                self._disparity(message),
                calibration_hash=self._hash,
                preview=self._of_same_exposure(running.ports.preview, message),
            )
        return None

    def close(self) -> None:
        """Stop the camera."""
        self._queue.close()

    def _disparity(self, message: Any) -> DisparityMap:
        try:
            values = np.asarray(message.getFrame())
        except RuntimeError as error:
            raise DeviceError(f"a disparity map of the OAK camera cannot be read: {error}: use mode=capture") from error
        if values.dtype != np.uint16 or values.shape != self._seen.shape:
            raise DeviceError(
                f"the camera gave disparities as {values.dtype} {values.shape}, but {self._seen.shape} in 16 bits were asked "
                "for: update depthai, or use mode=capture"
            )
        sureness = self._of_same_exposure(self._queue.running.ports.confidence, message)
        return self._plan.settings.disparity(values, self._plan.made.window, self._seen, sureness)

    def _of_same_exposure(self, queue: Any | None, message: Any) -> NDArray[np.uint8] | None:
        """Return the picture of another queue that belongs to a message; None where it was not asked for, or got lost."""
        if queue is None:
            return None
        for _ in range(_OTHER_MAPS_WAIT):
            other = queue.tryGet()
            if other is None or other.getSequenceNum() > message.getSequenceNum():
                return None
            if other.getSequenceNum() == message.getSequenceNum():
                with suppress(ImageError):
                    return picture(other)
        return None
