"""The field that both views share at one depth: where a pixel's ray is there, and whether the other view shows that point.

Depth is z in the left camera's frame, for pixels of either view. Pixels are upright. (`common_field` tells it pixel by pixel,
for the whole range at once.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration
from prismstereo_hw.view import Side, View

__all__ = ["at_depth", "common", "covered_share", "grid", "shows"]

Array = NDArray[np.float64]

_CELLS = 8  # a view is divided into so many by so many for its coverage
_SAMPLES = 4  # each way, in a cell
_REACH = 3.0  # times the near end: a board is hardly held farther away
_DEPTHS = 5


def grid(calibration: Calibration, side: Side, columns: int, rows: int) -> Array:
    """Return the upright pixels (rows, columns, 2) of the middles of so many equal fields of a view."""
    view = _camera_and_view(calibration, side)[1]
    x, y, _, _ = view.rectangle(calibration.frame_width, calibration.frame_height)
    w, h = view.upright_size(calibration.frame_width, calibration.frame_height)
    across = x - 0.5 + w * (np.arange(columns) + 0.5) / columns
    down = y - 0.5 + h * (np.arange(rows) + 0.5) / rows
    return np.stack(np.meshgrid(across, down), axis=-1)


def at_depth(camera: Camera, pixels: Array, depth: float | Array) -> Array:
    """Return the points (..., 3), in the left camera's frame, where the rays of pixels (..., 2) reach a depth (...)."""
    origin, direction = camera.rays(pixels)
    reach = (depth - origin[..., 2]) / direction[..., 2]
    return np.asarray(origin + reach[..., None] * direction)


def shows(calibration: Calibration, side: Side, pixels: Array, margin_px: float = 0.0) -> NDArray[np.bool_]:
    """Tell which upright pixels (..., 2) lie in a view, so far from its rectangle's borders."""
    view = _camera_and_view(calibration, side)[1]
    size = calibration.frame_width, calibration.frame_height
    x, y, _, _ = view.rectangle(*size)
    low = np.array([x, y], np.float64)
    high = low + np.array(view.upright_size(*size)) - 1
    inside = ((pixels >= low - 0.5 + margin_px) & (pixels <= high + 0.5 - margin_px)).all(axis=-1)
    return np.asarray(inside & view.shows(view.raw_from_upright(np.nan_to_num(pixels), *size), *size))


def common(calibration: Calibration, side: Side, pixels: Array, depth: float) -> NDArray[np.bool_]:
    """Tell which upright pixels (..., 2) of a view look at a point, at that depth, that the other view shows too."""
    camera, _ = _camera_and_view(calibration, side)
    other: Side = "right" if side == "left" else "left"
    seen = _camera_and_view(calibration, other)[0].project(at_depth(camera, pixels, depth))
    return np.asarray(shows(calibration, side, pixels) & shows(calibration, other, seen))


def covered_share(calibration: Calibration, side: Side, corners: Array) -> float:
    """Return the share of a view's 8 x 8 cells with a corner (..., 2) in it, of those in the field of both views.

    The common field is that of the near part of the range, where a board can be held. NaN where there is none.
    """
    size = _CELLS * _SAMPLES
    pixels = grid(calibration, side, size, size)
    near, far = calibration.range.near_mm, calibration.range.far_mm
    depths = np.geomspace(near, min(far, _REACH * near), _DEPTHS)
    seen = np.any([common(calibration, side, pixels, float(depth)) for depth in depths], axis=0)
    cells = seen.reshape(_CELLS, _SAMPLES, _CELLS, _SAMPLES).mean(axis=(1, 3)) >= 0.5
    if not cells.any():
        return math.nan
    points = corners.reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1)]
    step = pixels[_SAMPLES, _SAMPLES] - pixels[0, 0]
    column, row = np.floor((points - (pixels[0, 0] - step / (2 * _SAMPLES))) / step).astype(int).T
    inside = (column >= 0) & (column < _CELLS) & (row >= 0) & (row < _CELLS)
    hit = np.zeros((_CELLS, _CELLS), bool)
    hit[row[inside], column[inside]] = True
    return float(np.count_nonzero(hit & cells) / np.count_nonzero(cells))


def _camera_and_view(calibration: Calibration, side: Side) -> tuple[Camera, View]:
    if side == "left":
        return calibration.left, calibration.left_view
    return calibration.right, calibration.right_view
