"""What a rig file promises as two cameras: exact ones, but where glass bends directions.

Mirrors make exact pinholes, and a prism that unfolds to a plate makes cameras behind a plate. Glass that bends directions
gets the lens and the pose for each view that fit it best over the rig's range (reference: optics, not a single viewpoint).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.least_squares import least_squares
from prismstereo_calibration.plate import Plate
from prismstereo_hw.lens import Lens
from prismstereo_hw.optics.outlook import outlook
from prismstereo_hw.optics.sight import Sight, sight
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import Side

__all__ = ["nominal_cameras", "nominal_plate"]

Array = NDArray[np.float64]
_GRID = (20, 12)
_DEPTHS = 6
_LEAST_KEPT = 0.1  # of a view's pixels
_SIDES: tuple[Side, Side] = ("left", "right")


@dataclass(frozen=True, slots=True)
class _Pinhole:
    """A lens in raw-frame pixels, and X_view = R X_rig + t; det R = -1 for a mirror image."""

    lens: Lens
    R: Array
    t: Array


def nominal_cameras(rig: Rig) -> tuple[Camera, Camera]:
    """Return the left and the right camera that a rig promises, in upright pixels and the left camera's frame."""
    pinholes = _unfolded(rig) or tuple(_fit_alone(rig, side) for side in _SIDES)
    video = rig.camera.video
    upright = []
    for pinhole, view in zip(pinholes, rig.views, strict=True):
        flip = np.diag([-1.0, 1.0, 1.0]) if view.mirrored else np.eye(3)
        lens = view.upright_lens(pinhole.lens, video.width, video.height)
        upright.append(_Pinhole(lens, flip @ pinhole.R, flip @ pinhole.t))
    left, right = upright
    R = right.R @ left.R.T
    plate = nominal_plate(rig)
    return Camera.at_origin(left.lens, plate), Camera(right.lens, R, right.t - R @ left.t, plate)


def _unfolded(rig: Rig) -> tuple[_Pinhole, _Pinhole] | None:
    """Return both views of a rig that has a closed form, with one lens; None otherwise."""
    left, right = (rig.folded(side) for side in _SIDES)
    if left is None or right is None:
        return None
    for side in _SIDES:
        _lit(rig, side)
    one, other = (_Pinhole(rig.lens(), view.R, view.view_from_rig(np.zeros(3))) for view in (left, right))
    return one, other


def nominal_plate(rig: Rig) -> Plate | None:
    """Return the glass that stands before both views of a rig; None for mirrors alone and for glass that is no plate."""
    view = rig.folded("left")
    return Plate(view.plate_mm, view.index) if view is not None and view.plate_mm else None


def _fit_alone(rig: Rig, side: Side) -> _Pinhole:
    """Fit a lens of nine numbers and a pose to the traced rays of one view."""
    view, true = sight(rig, side), rig.lens()
    points, pixels = _sample(rig, view)
    start = np.array([true.fx_px, true.fy_px, true.cx_px, true.cy_px, *true.distortion, *np.zeros(6)])

    def pinhole(p: Array) -> _Pinhole:
        fx, fy, cx, cy, *distortion = (float(number) for number in p[:9])
        k1, k2, p1, p2, k3 = distortion
        turn = _small_turn(p[9:12])
        t = turn @ (-view.R @ view.centre_mm) + p[12:]
        return _Pinhole(Lens(fx, fy, cx, cy, (k1, k2, p1, p2, k3)), turn @ view.R, t)

    def projected(p: Array) -> Array:
        at = pinhole(p)
        return at.lens.project(points @ at.R.T + at.t)

    steps = np.array([1e-3] * 4 + [1e-6] * 5 + [1e-7] * 3 + [1e-5] * 3)
    return pinhole(least_squares(projected, pixels, start, steps))


def _small_turn(turn: Array) -> Array:
    """Return the rotation (3, 3) about a short vector (3,), exactly orthonormal (Cayley's form)."""
    x, y, z = turn / 2
    W = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.linalg.solve(np.eye(3) - W, np.eye(3) + W))


def _sample(rig: Rig, view: Sight) -> tuple[Array, Array]:
    """Return rig points (N, 3), evenly spread over picture and disparity, and their exact raw pixels (N, 2)."""
    looking, pixels = outlook(rig), _lit(rig, view.side)
    origin, direction = view.rays(rig.lens().slopes(pixels))
    near, far = rig.range.near_mm, min(rig.range.far_mm, 100 * rig.range.near_mm)
    depth = 1 / np.linspace(1 / near, 1 / far, _DEPTHS)
    reach = (depth[:, None] - looking.to_scene(origin)[:, 2]) / (direction @ looking.R_rig_from_scene)[:, 2]
    points = origin + reach[..., None] * direction
    return points.reshape(-1, 3), np.tile(pixels, (_DEPTHS, 1))


def _lit(rig: Rig, side: Side) -> Array:
    """Return the raw pixels (N, 2) of a grid over a view that light comes to; refuse a rig that shows next to nothing."""
    video = rig.camera.video
    x, y, w, h = rig.views[_SIDES.index(side)].rectangle(video.width, video.height)
    columns, rows = np.meshgrid(np.linspace(x, x + w - 1, _GRID[0]), np.linspace(y, y + h - 1, _GRID[1]))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)
    kept = view_fates(rig, side, rig.lens().slopes(pixels)).fate == 0
    if np.count_nonzero(kept) < _LEAST_KEPT * kept.size:
        raise CalibrationError(f"rig {rig.name!r} shows next to nothing: see `prismstereo design` for its limits")
    return np.asarray(pixels[kept])
