"""A calibration as everybody knows it: two pinhole cameras side by side, each with a picture of its own.

The views are cut out of the raw frame and set upright, so each has its own pixel (0, 0): principal points are those of
the full frame less the corner of the view's rectangle. What else a calibration knows - where the views lie in the
frame, the range, glass - has no place in other formats; on the way back it comes from a rig or a layout.

Frames and pixels as everywhere here: x right, y down, z forward; X_right = R X_left + t; (0, 0) is a pixel's centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration, Model, Unit
from prismstereo_calibration.rectification import Rectification, rectification
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.lens import Lens
from prismstereo_hw.rig import RangeWish
from prismstereo_hw.view import View

__all__ = ["PairCamera", "RectifiedPair", "StereoPairModel", "calibration_of", "pair_of"]

Array = NDArray[np.float64]
_LABELS = 128
_SAME_LENS = 1e-5  # relative: what a file of 32-bit numbers keeps


@dataclass(frozen=True, slots=True)
class PairCamera:
    """One view as a camera: its lens in pixels of the cut-out upright picture, and that picture's width and height.

    The size is None where a file does not tell it; of an interlaced view the picture has one row in `row_step`.
    """

    lens: Lens
    size: tuple[int, int] | None
    row_step: int = 1


@dataclass(frozen=True, slots=True)
class RectifiedPair:
    """How both views become rectified pictures of one size: turns (3, 3) and projections (3, 4), lengths in the pair's unit.

    P[0, 3] of the right one is -f * baseline. The principal columns differ by the offset of the range window:
    depth = f * baseline / (disparity - (cx_left - cx_right)).
    """

    R_left: Array
    R_right: Array
    P_left: Array
    P_right: Array
    size: tuple[int, int]

    @classmethod
    def of(cls, found: Rectification, R_right_from_left: Array, baseline: float) -> RectifiedPair:
        """Put our own rectification into matrices."""
        f, cy = found.focal_px, found.cy_px
        left = np.array([[f, 0.0, found.left.cx_px, 0.0], [0.0, f, cy, 0.0], [0.0, 0.0, 1.0, 0.0]])
        right = np.array([[f, 0.0, found.right.cx_px, -f * baseline], [0.0, f, cy, 0.0], [0.0, 0.0, 1.0, 0.0]])
        turns = found.left.R_rectified_from_left, found.right.R_rectified_from_left @ R_right_from_left.T
        return cls(*turns, left, right, (found.width, found.height))

    @property
    def Q(self) -> Array:
        """The (4, 4) matrix that takes (x_left, y, disparity, 1) to a point of the rectified frame."""
        f, baseline = self.P_left[0, 0], -self.P_right[0, 3] / self.P_right[0, 0]
        left, right, y = self.P_left[0, 2], self.P_right[0, 2], self.P_left[1, 2]
        rows = [[1, 0, 0, -left], [0, 1, 0, -y], [0, 0, 0, f], [0, 0, 1 / baseline, (right - left) / baseline]]
        return np.array(rows, float)


@dataclass(frozen=True, slots=True)
class StereoPairModel:
    """Two cameras and the right one's pose, R (3, 3) and t (3,) in `unit`; rectification where it is known.

    `assumed` says in sentences what a file left open and was taken for granted when it was read. Where glass was left
    out, `glass_rms_px` tells what that costs, and the left pinhole stands `glass_shift` farther along its axis.
    """

    left: PairCamera
    right: PairCamera
    R_right_from_left: Array
    t_right_from_left: Array
    unit: Unit = "mm"
    rectified: RectifiedPair | None = None
    lens_position: int | None = None
    glass_rms_px: float = 0.0
    glass_shift: float = 0.0
    assumed: tuple[str, ...] = ()

    @property
    def cameras(self) -> tuple[PairCamera, PairCamera]:
        """The left and the right camera."""
        return self.left, self.right


def pair_of(calibration: Calibration) -> StereoPairModel:
    """Return the two pinhole cameras of a calibration; where it has glass, those that stand for it best.

    `UsageError` when the calibration's own range cannot be rectified.
    """
    flat, nearest = calibration.pinholes(), calibration.nearest_pinholes()
    cameras = []
    for camera, view in zip((flat.left, flat.right), flat.views, strict=True):
        x, y, _, _ = view.rectangle(flat.frame_width, flat.frame_height)
        lens = replace(camera.lens, cx_px=camera.lens.cx_px - x, cy_px=camera.lens.cy_px - y)
        cameras.append(PairCamera(lens, view.upright_size(flat.frame_width, flat.frame_height), view.row_step))
    return StereoPairModel(
        left=cameras[0],
        right=cameras[1],
        R_right_from_left=flat.right.R_camera_from_left,
        t_right_from_left=flat.right.t_camera_from_left,
        unit=flat.unit,
        rectified=RectifiedPair.of(rectification(flat), flat.right.R_camera_from_left, flat.baseline),
        lens_position=flat.lens_position,
        glass_rms_px=nearest.residual_px,
        glass_shift=nearest.shift,
    )


def calibration_of(
    pair: StereoPairModel, views: tuple[View, View], frame: tuple[int, int], wish: RangeWish | None, rig: str
) -> Calibration:
    """Return the calibration of a pair whose pictures are these views of a frame (width, height).

    Without a wish the range is what 128 labels reach from infinity. `CalibrationError` for numbers that no camera has.
    """
    lenses = []
    for camera, view in zip(pair.cameras, views, strict=True):
        x, y, _, _ = view.rectangle(*frame)
        lenses.append(replace(camera.lens, cx_px=camera.lens.cx_px + x, cy_px=camera.lens.cy_px + y))
    found = Calibration(
        rig=rig,
        frame_width=frame[0],
        frame_height=frame[1],
        left_view=views[0],
        right_view=views[1],
        left=Camera.at_origin(lenses[0]),
        right=Camera(lenses[1], pair.R_right_from_left, pair.t_right_from_left),
        range=wish or RangeWish(near_mm=1.0, far_mm=math.inf, labels=_LABELS),  # until the baseline is known
        model=_model(lenses[0], lenses[1], views, frame),
        unit=pair.unit,
        lens_position=pair.lens_position,
    )
    if wish is not None:
        return found
    window = DisparityWindow.reaching(found.focal_px * found.baseline, math.inf, _LABELS)
    return replace(found, range=RangeWish(near_mm=window.nearest, far_mm=math.inf, labels=_LABELS))


def _model(left: Lens, right: Lens, views: tuple[View, View], frame: tuple[int, int]) -> Model:
    """Tell whether both lenses are the same one of a single focal length, seen in two views."""
    if any(view.turn_deg for view in views) or any(view.exposures > 1 for view in views):
        return "two-camera"
    step, (x, y, w, _) = views[0].row_step, views[0].rectangle(*frame)
    own = left.mirrored(x + (w - 1) / 2) if views[0].mirrored else left
    whole = replace(own, fy_px=own.fy_px * step, cy_px=(own.cy_px - y) * step + views[0].row_start + y)
    expected = views[1].upright_lens(whole, *frame)
    found, wanted = ([lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion] for lens in (right, expected))
    alike = np.allclose(found, wanted, rtol=_SAME_LENS, atol=_SAME_LENS)
    square = np.isclose(whole.fx_px, whole.fy_px, rtol=_SAME_LENS)
    return "one-lens" if alike and square else "two-camera"
