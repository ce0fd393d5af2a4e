"""What rows cannot be trusted to say: the errors that a calibration already had on the day it was made.

A lens that is known to 0.15 % leaves a pattern of vertical disparity that looks like a turn of the mirrors. A scene must not
be allowed to mend what never moved, so each such pattern, at the size of one standard deviation, takes part in the fit as an
unknown of its own, and is then left out of the result. So does glass that the unit has and the calibration leaves out: its
pinholes are right where the board stood, and off by tenths of a pixel at the distances of a scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.pinholes import nearest_pinholes
from prismstereo_calibration.plate import Plate
from prismstereo_calibration.solving.poses import rotations
from prismstereo_calibration.uncertainty import NUMBERS
from prismstereo_calibration.upkeep.sightlines import SceneMatches, Sightlines
from prismstereo_hw.lens import Lens

__all__ = ["doubts_px"]

Array = NDArray[np.float64]
_FOCAL_DOUBT = 0.0015  # of the focal length, of a calibration that does not say (reference: optics, section 4)
_LEAST_PX = 1e-4  # patterns below this are not worth an unknown
_LENS_NUMBERS = 9
_FAR = 1e4  # along a ray: any point of it has the same pixel
_STEP = 0.1  # of a standard deviation
_BOARDS_NEAR = 0.5  # of the range's near end: where the nearest of the boards stand


def doubts_px(calibration: Calibration, scenes: Sequence[SceneMatches], plate: Plate | None = None) -> Array:
    """Return the vertical disparity (N, q) in pixels that each doubt about a calibration, at one sigma, puts on the points.

    `plate`: the glass that the unit has; a doubt where the calibration leaves it out.
    """
    left_px = np.concatenate([np.zeros((0, 2)), *(scene.left_px for scene in scenes)])
    matches = SceneMatches("", left_px, _met_px(calibration, scenes))
    patterns = [_rows_px(_changed(calibration, _STEP * doubt), matches) / _STEP for doubt in _directions(calibration)]
    if plate is not None and calibration.left.plate is None:
        patterns.append(_glass_px(calibration, scenes, plate))
    kept = [pattern for pattern in patterns if np.sqrt(np.mean(pattern**2)) > _LEAST_PX]
    return np.stack(kept, axis=1) if kept else np.zeros((len(left_px), 0))


def _met_px(calibration: Calibration, scenes: Sequence[SceneMatches]) -> Array:
    """Return the right pixels (N, 2) moved to where this calibration wants them: a longer lens must not magnify noise."""
    right = calibration.right
    met = Sightlines.of(calibration, scenes).met(right.R_camera_from_left, right.t_camera_from_left)
    return Camera.at_origin(right.lens, right.plate).project(met.right_from + _FAR * met.right_along)


def _rows_px(calibration: Calibration, matches: SceneMatches) -> Array:
    right = calibration.right
    return Sightlines.of(calibration, [matches]).rows_px(right.R_camera_from_left, right.t_camera_from_left)


def _glass_px(calibration: Calibration, scenes: Sequence[SceneMatches], plate: Plate) -> Array:
    """Return the rows (N,) left by pinholes that were fitted to these cameras behind glass, on boards nearer than the range."""
    left, right = (replace(camera, plate=plate) for camera in (calibration.left, calibration.right))
    behind = replace(calibration, left=left, right=right, unit="mm")  # any unit: only pixels come of it
    frame, near = (calibration.frame_width, calibration.frame_height), calibration.range.near_mm
    nearest = nearest_pinholes(left, right, calibration.views, frame, _BOARDS_NEAR * near, near)
    left_px = np.concatenate([np.zeros((0, 2)), *(scene.left_px for scene in scenes)])
    matches = SceneMatches("", left_px, _met_px(behind, scenes))
    return _rows_px(replace(calibration, left=nearest.left, right=nearest.right), matches)


def _directions(calibration: Calibration) -> Array:
    """Return independent doubts (q, 24) of one sigma each, in the numbers of `uncertainty`."""
    if calibration.uncertainty is None:
        return _usual(calibration)[None]
    covariance = calibration.uncertainty.covariance
    scale = np.sqrt(np.diag(covariance))
    safe = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    known = values > 1e-9 * max(float(values[-1]), 1e-300)
    return np.asarray((vectors[:, known] * np.sqrt(values[known])).T * scale)


def _usual(calibration: Calibration) -> Array:
    """Return the doubt that every calibration has: a longer lens, and views turned so that depths stay as they are."""
    doubt = np.zeros(len(NUMBERS))
    turn = 0.0
    for side, camera, view, sign in (
        ("left", calibration.left, calibration.left_view, 1.0),
        ("right", calibration.right, calibration.right_view, -1.0),
    ):
        lens = camera.lens
        doubt[NUMBERS.index(f"{side}_fx_px")] = _FOCAL_DOUBT * lens.fx_px
        doubt[NUMBERS.index(f"{side}_fy_px")] = _FOCAL_DOUBT * lens.fy_px
        x, _, _, _ = view.rectangle(calibration.frame_width, calibration.frame_height)
        w, _ = view.upright_size(calibration.frame_width, calibration.frame_height)
        turn += sign * _FOCAL_DOUBT * (x + (w - 1) / 2 - lens.cx_px) / lens.fx_px
    doubt[NUMBERS.index("turn_y_rad")] = turn
    return doubt


def _changed(calibration: Calibration, change: Array) -> Calibration:
    """Return a calibration whose 24 numbers are changed."""
    left, right = calibration.left, calibration.right
    turn, shift = change[2 * _LENS_NUMBERS :][:3], change[2 * _LENS_NUMBERS :][3:]
    return replace(
        calibration,
        left=replace(left, lens=_lens(left.lens, change[:_LENS_NUMBERS])),
        right=Camera(
            _lens(right.lens, change[_LENS_NUMBERS : 2 * _LENS_NUMBERS]),
            rotations(turn) @ right.R_camera_from_left,
            right.t_camera_from_left + shift,
            right.plate,
        ),
    )


def _lens(lens: Lens, change: Array) -> Lens:
    fx, fy, cx, cy, *distortion = (
        float(number)
        for number in np.array([lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.distortion]) + change
    )
    k1, k2, p1, p2, k3 = distortion
    return Lens(fx, fy, cx, cy, (k1, k2, p1, p2, k3))
