"""The calibration: two virtual cameras behind one real lens, and the range they are used for.

`nominal` is what the rig file promises. `solve` measures a built unit,
seeded by it. Lengths are in `unit`: millimetres, or board squares where nobody said how large a square is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.nominal import nominal_cameras
from prismstereo_calibration.outputs import Output
from prismstereo_calibration.photometry import Photometry
from prismstereo_calibration.pinholes import Pinholes, nearest_pinholes
from prismstereo_calibration.static_mask import StaticMask
from prismstereo_calibration.uncertainty import Uncertainty
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.rig import RangeWish, Rig
from prismstereo_hw.view import View

__all__ = ["Calibration", "Model", "Unit"]

Array = NDArray[np.float64]
Model = Literal["one-lens", "two-camera"]
Unit = Literal["mm", "square"]

_ORTHOGONAL = 1e-6
_LARGEST_SIDE_PX = 16384
_SMALLEST_VIEW_PX = 16
_PLACES = 9  # each way, at which a view's distortion is tried
_LEAST_UNFOLDED = 0.6  # of them: far from all corners a polynomial may fold, and what lies there is in no map


@dataclass(frozen=True, slots=True)
class Calibration:
    """Everything that turns a raw frame into metric depth; checked when made, `CalibrationError` names what is wrong."""

    rig: str
    frame_width: int
    frame_height: int
    left_view: View
    right_view: View
    left: Camera
    right: Camera
    range: RangeWish
    model: Model = "one-lens"
    unit: Unit = "mm"
    lens_position: int | None = None
    rms_px: float | None = None
    views_used: int = 0
    temperature_c: float | None = None
    uncertainty: Uncertainty | None = None
    outputs: tuple[Output, ...] = ()
    photometry: Photometry | None = None
    mask: StaticMask | None = None

    def __post_init__(self) -> None:
        """Refuse what no camera can be."""
        _check_frame(self)
        _check_numbers(self)
        _check_pose(self)
        if self.mask is not None:
            sizes = [view.upright_size(self.frame_width, self.frame_height) for view in self.views]
            self.mask.require_sizes(sizes[0], sizes[1])

    @property
    def baseline(self) -> float:
        """Distance of the two pinholes, in `unit`."""
        return float(np.linalg.norm(self.right.t_camera_from_left))

    @property
    def focal_px(self) -> float:
        """Focal length of the rectified pictures: the mean of both cameras' both, full rows for interlaced views."""
        pairs = zip((self.left.lens, self.right.lens), self.views, strict=True)
        return sum(lens.fx_px + lens.fy_px * view.row_step for lens, view in pairs) / 4

    @property
    def views(self) -> tuple[View, View]:
        """The left and the right view."""
        return self.left_view, self.right_view

    @classmethod
    def nominal(cls, rig: Rig) -> Calibration:
        """Return what the rig file promises, glass included."""
        left, right = nominal_cameras(rig)
        left_view, right_view = rig.views
        return cls(
            rig=rig.name,
            frame_width=rig.camera.video.width,
            frame_height=rig.camera.video.height,
            left_view=left_view,
            right_view=right_view,
            left=left,
            right=right,
            range=rig.range,
            model="one-lens" if rig.folded("left") else "two-camera",
        )

    def pinholes(self) -> Calibration:
        """Return this calibration with the pinholes that come nearest over its range; itself where there is no glass.

        What it says of its uncertainty goes: it belongs to the cameras behind glass.
        """
        nearest = self.nearest_pinholes()
        if nearest.left is self.left:
            return self
        return replace(self, left=nearest.left, right=nearest.right, uncertainty=None)

    def nearest_pinholes(self) -> Pinholes:
        """Return the two pinholes that come nearest over the range, and what they leave in pixels."""
        frame, near = (self.frame_width, self.frame_height), self.range.near_mm
        return nearest_pinholes(self.left, self.right, self.views, frame, near, self.range.far_mm)

    def require_frame(self, frame: RawFrame) -> None:
        """Refuse a frame of another size or another focus than this calibration was made for."""
        exposures = self.left_view.exposures
        if (frame.width, frame.height) != (self.frame_width, self.frame_height * exposures):
            raise CalibrationError(
                f"frame {frame.index} is {frame.width}x{frame.height}, but the calibration of {self.rig!r} is for "
                f"{self.frame_width}x{self.frame_height}: calibrate this mode, or capture in the calibrated one"
            )
        positions = frame.lens_position, self.lens_position
        if None not in positions and positions[0] != positions[1]:
            raise CalibrationError(
                f"frame {frame.index} was taken at lens position {frame.lens_position}, but the calibration of "
                f"{self.rig!r} is for {self.lens_position}: lock the focus there, or calibrate again"
            )


def _check_frame(calibration: Calibration) -> None:
    width, height = calibration.frame_width, calibration.frame_height
    if not (0 < width <= _LARGEST_SIDE_PX and 0 < height <= _LARGEST_SIDE_PX):
        raise CalibrationError(
            f"the calibration is for frames of {width}x{height}: no sensor gives less than 1 or more than "
            f"{_LARGEST_SIDE_PX} pixels a side"
        )
    for side, view in zip(("left", "right"), calibration.views, strict=True):
        w, h = view.upright_size(width, height)
        if min(w, h) < _SMALLEST_VIEW_PX:
            raise CalibrationError(
                f"the {side} view is {w}x{h} pixels of a frame of {width}x{height}: give rectangles of at least "
                f"{_SMALLEST_VIEW_PX} pixels a side"
            )


def _check_numbers(calibration: Calibration) -> None:
    width = calibration.frame_width
    cameras = (("left", calibration.left, calibration.left_view), ("right", calibration.right, calibration.right_view))
    for side, camera, view in cameras:
        lens = camera.lens
        values = (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion)
        if not all(math.isfinite(value) for value in values):
            raise CalibrationError(f"{side} camera has a number that is not finite: {lens}: calibrate again")
        if not (0.1 * width < lens.fx_px < 50 * width and 0.5 < lens.fx_px / max(lens.fy_px * view.row_step, 1e-9) < 2):
            raise CalibrationError(
                f"{side} camera has focal lengths {lens.fx_px:.1f}, {lens.fy_px:.1f} px on a frame {width} px wide: "
                "no lens is like that, calibrate again with more and more tilted views"
            )
        if not (-width < lens.cx_px < 2 * width and abs(lens.cy_px) < 3 * calibration.frame_height):
            raise CalibrationError(
                f"{side} camera has its principal point at {lens.cx_px:.1f}, {lens.cy_px:.1f} px, far outside the "
                f"frame of {width}x{calibration.frame_height}: calibrate again"
            )
        seen = np.isfinite(camera.lens.slopes(_places(calibration, view))).all(axis=-1)
        if np.mean(seen) < _LEAST_UNFOLDED:
            raise CalibrationError(
                f"{side} camera's distortion {camera.lens.distortion} folds the picture inside its own view: "
                "calibrate again with corners near the borders of the view"
            )


def _places(calibration: Calibration, view: View) -> Array:
    """Return upright pixels (N, 2) evenly over a view, where it shows anything."""
    frame = calibration.frame_width, calibration.frame_height
    x, y, _, _ = view.rectangle(*frame)
    w, h = view.upright_size(*frame)
    columns, rows = np.meshgrid(np.linspace(x, x + w - 1, _PLACES), np.linspace(y, y + h - 1, _PLACES))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)
    return np.asarray(pixels[view.shows(view.raw_from_upright(pixels, *frame), *frame)])


def _check_pose(calibration: Calibration) -> None:
    left, right = calibration.left, calibration.right
    if not (np.array_equal(left.R_camera_from_left, np.eye(3)) and not np.any(left.t_camera_from_left)):
        raise CalibrationError(
            "the left camera does not stand at the origin: poses are given in its frame, the file was written by hand"
        )
    R, t = right.R_camera_from_left, right.t_camera_from_left
    if not (np.isfinite(R).all() and np.isfinite(t).all()):
        raise CalibrationError("the pose of the right camera has a number that is not finite: calibrate again")
    if np.abs(R @ R.T - np.eye(3)).max() > _ORTHOGONAL or np.linalg.det(R) < 0:
        raise CalibrationError("R_right_from_left is not a rotation: the file was damaged or written by hand")
    if not calibration.baseline > 0 or right.centre[0] + (R @ right.centre)[0] <= 0:
        raise CalibrationError(
            f"the right camera stands at {np.round(right.centre, 3)} of the left one, not to its right: left and "
            "right are exchanged; give the frames or the layout the other way round"
        )
    if calibration.left.plate != calibration.right.plate:
        raise CalibrationError(
            "the two views have different glass before them: one prism is one plate, give it to both"
        )
    if calibration.left.plate is not None and calibration.unit != "mm":
        raise CalibrationError("glass has a thickness in mm, but the unit is squares: calibrate with --square-mm")
