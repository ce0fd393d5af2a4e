"""A distance that somebody measured, as an equation for `refine`: to a plane before the unit, or to what one pixel shows."""

from __future__ import annotations

import math

import numpy as np

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_calibration.upkeep.pose_fit import KnownDepth
from prismstereo_calibration.upkeep.sightlines import SceneMatches, Sightlines
from prismstereo_hw.errors import UsageError

__all__ = ["known_distance"]

_TAPE = 0.001  # of the distance: a tape measure, and whoever holds it
_AROUND = 0.03  # of the frame's width: what counts as seen at a pixel
_FEWEST = 8
_SAME = 0.02  # of the depth: what belongs to the same thing


def known_distance(
    calibration: Calibration, scene: SceneMatches, distance: float, at_px: tuple[float, float] | None = None
) -> KnownDepth:
    """Return the equation of a known depth in the calibration's unit: of a plane that faces the unit, or at a raw pixel.

    The depth is the one that every depth map here has: along the view from the line between the two viewpoints. `at_px` is a
    raw-frame pixel of the left viewpoint. `UsageError` for a depth that is none or a pixel that is not in that view;
    `CalibrationError` where the scene shows too little there, or several depths.
    """
    if not (math.isfinite(distance) and distance > 0):
        raise UsageError(f"a known distance of {distance:g}: give one above 0, as depth maps have it")
    chosen = scene if at_px is None else _around(calibration, scene, at_px)
    lines = Sightlines.of(calibration, [chosen])
    ahead = np.asarray(rectification(calibration).left.R_rectified_from_left[2])
    if len(lines.scene):
        right = calibration.right
        nearness = lines.nearness(right.R_camera_from_left, right.t_camera_from_left, ahead)
        middle = float(np.median(nearness))
        lines = lines.only(np.abs(nearness / middle - 1) < _SAME) if middle > 0 else lines.only(nearness > math.inf)
    share = len(lines.scene) / max(len(chosen.left_px), 1)
    where = "" if at_px is None else f" around pixel {at_px[0]:g},{at_px[1]:g}"
    if len(lines.scene) < _FEWEST or share < 0.5:
        raise CalibrationError(
            f"{scene.name} shows {len(lines.scene)} points of one depth{where} in both views, {100 * share:.0f} % of all "
            f"there, and {_FEWEST} points and half of them are needed: give a flat textured thing that faces the unit"
        )
    return KnownDepth(lines, distance, _TAPE * distance, ahead)


def _around(calibration: Calibration, scene: SceneMatches, at_px: tuple[float, float]) -> SceneMatches:
    view, frame = calibration.left_view, (calibration.frame_width, calibration.frame_height)
    place = view.upright_from_raw(np.array(at_px, float), *frame)
    x, y, _, _ = view.rectangle(*frame)
    w, h = view.upright_size(*frame)
    if not (x <= place[0] < x + w and y <= place[1] < y + h):
        raise UsageError(
            f"pixel {at_px[0]:g},{at_px[1]:g} is not in the left viewpoint's view, columns {x} to {x + w - 1} and rows {y} to "
            f"{y + h - 1} of the raw frame: give one that is"
        )
    away = np.linalg.norm(scene.left_px - place, axis=1)
    return scene.only(away < _AROUND * calibration.frame_width)
