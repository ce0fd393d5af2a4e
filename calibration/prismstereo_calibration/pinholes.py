"""The pinhole cameras nearest to cameras behind glass: for formats, and for maps, that know nothing of a plate.

Focal length, two distortion terms and a shift along the axis, the same for both views, take up most of what the plate does;
what they leave is `residual_px` (reference: optics, section 2: 0.05 px rms for a one-inch prism on a lens of 35 degrees,
0.11 on one of 58).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.least_squares import least_squares
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

__all__ = ["Pinholes", "nearest_pinholes"]

Array = NDArray[np.float64]
_GRID = (20, 12)
_DEPTHS = 6
_FARTHEST = 100.0  # times the nearest depth stands for infinity


@dataclass(frozen=True, slots=True)
class Pinholes:
    """Two pinhole cameras, the first at the origin of its own frame.

    That frame is the left camera's, moved by `shift` along its axis. `residual_px`: root mean square over both views and the
    range of what they leave, in pixels.
    """

    left: Camera
    right: Camera
    shift: float
    residual_px: float


def nearest_pinholes(
    left: Camera, right: Camera, views: tuple[View, View], frame: tuple[int, int], near: float, far: float
) -> Pinholes:
    """Return the pinholes that see points between two depths most like these cameras, on frames (width, height).

    Cameras without glass come back as they are.
    """
    if left.plate is None or right.plate is None:
        return Pinholes(left, right, 0.0, 0.0)
    samples = [_sample(camera, view, frame, near, far) for camera, view in zip((left, right), views, strict=True)]
    points = [own for own, _ in samples]
    pixels = np.concatenate([seen for _, seen in samples])

    def projected(p: Array) -> Array:
        lenses = (_changed(left.lens, p), _changed(right.lens, p))
        back = np.array([0.0, 0.0, p[3]])
        return np.concatenate([lens.project(own - back) for lens, own in zip(lenses, points, strict=True)])

    k1, k2 = left.lens.distortion[:2]
    start, steps = np.array([1.0, k1, k2, 0.0]), np.array([1e-6, 1e-5, 1e-5, 1e-4])
    found = least_squares(projected, pixels, start, steps)
    residual_px = float(np.sqrt(np.mean(np.sum((projected(found) - pixels) ** 2, axis=-1))))
    back = np.array([0.0, 0.0, float(found[3])])
    R = right.R_camera_from_left
    one = Camera.at_origin(_changed(left.lens, found))
    other = Camera(_changed(right.lens, found), R, right.t_camera_from_left + R @ back - back)
    return Pinholes(one, other, float(found[3]), residual_px)


def _changed(lens: Lens, p: Array) -> Lens:
    """Return a lens with another focal length, k1 and k2; right and left may differ in all but those."""
    _, _, p1, p2, k3 = lens.distortion
    return replace(
        lens,
        fx_px=lens.fx_px * float(p[0]),
        fy_px=lens.fy_px * float(p[0]),
        distortion=(float(p[1]), float(p[2]), p1, p2, k3),
    )


def _sample(camera: Camera, view: View, frame: tuple[int, int], near: float, far: float) -> tuple[Array, Array]:
    """Return points (N, 3) of a camera's own frame, evenly over its view and over disparity, and their pixels (N, 2)."""
    assert camera.plate is not None
    x, y, _, _ = view.rectangle(*frame)
    w, h = view.upright_size(*frame)
    columns, rows = np.meshgrid(np.linspace(x, x + w - 1, _GRID[0]), np.linspace(y, y + h - 1, _GRID[1]))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)
    slopes = camera.lens.slopes(pixels)
    kept = np.isfinite(slopes).all(axis=-1) & camera.plate.admits(slopes)
    slopes, pixels = slopes[kept], pixels[kept]
    farthest = min(far, _FARTHEST * near) if math.isfinite(far) else _FARTHEST * near
    depth = 1 / np.linspace(1 / near, 1 / farthest, _DEPTHS)
    along = depth[:, None] - camera.plate.crossing_mm(slopes)
    points = np.concatenate(
        [slopes * along[..., None], np.broadcast_to(depth[:, None, None], (*along.shape, 1))], axis=-1
    )
    return points.reshape(-1, 3), np.tile(pixels, (_DEPTHS, 1))
