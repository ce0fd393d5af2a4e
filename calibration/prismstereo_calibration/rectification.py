"""Rectification: how both views must be turned, scaled and shifted so that a match lies on the same row, to its left.

Rectified frame: origin in the left pinhole, x along the baseline, z halfway between the two views' middles made square
to it, y down. Both rectified pictures have the same focal length and the same rows; their principal columns differ by
the offset of the range window, so that disparity 1 is the far end of the range.

Behind a prism the optical axes of the two views diverge and the principal point sits at each view's inner border. What
is kept in the picture is therefore the *view*, not the principal point: the columns are chosen so that, over the whole
range window, most of what both views see has a place in both pictures.

Behind glass a view is no pinhole. The rectified pictures are those of the two pinholes that come nearest, exact at one depth in
the middle of the window; what that leaves of disparity elsewhere is smooth and known, and the window gives it back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.glass_parallax import GlassParallax
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.rig import RangeWish
from prismstereo_hw.view import View

__all__ = ["Rectification", "RectifiedView", "rectification"]

Array = NDArray[np.float64]
_DEPTH_SAMPLES = 16
_GLASS_GRID = (25, 17)
_BORDER_STEPS = 32  # from the middle of a view to either border
_NEXT_PX = 16
_NEARLY_INFINITE = 1e-3  # pixels of parallax


@dataclass(frozen=True, slots=True)
class RectifiedView:
    """One view's way from rectified to raw: its camera, where its rectified pinhole stands and looks, its principal column.

    `pinhole` (3,) is in the left camera's frame, like the rows of `R_rectified_from_left` (3, 3).
    """

    camera: Camera
    view: View
    R_rectified_from_left: Array
    pinhole: Array
    cx_px: float


@dataclass(frozen=True, slots=True)
class Rectification:
    """Everything needed to build rectification maps and to make metric depth of what was matched on them.

    `exact_at`: the depth at which the maps of views behind glass are exact; any other will do for pinholes.
    """

    left: RectifiedView
    right: RectifiedView
    focal_px: float
    cy_px: float
    width: int
    height: int
    frame_width: int
    frame_height: int
    window: DisparityWindow
    unit: str
    exact_at: float = 1.0

    def sources(self, side: RectifiedView) -> NDArray[np.float32]:
        """Return, for every rectified pixel, the pixel (height, width, 2) of the upright cut-out view; NaN outside of it."""
        columns, rows = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        points = self.points_at(np.stack([columns, rows], axis=-1), np.full(columns.shape, self.exact_at), side)
        camera = side.camera
        own = points @ camera.R_camera_from_left.T + camera.t_camera_from_left
        ahead = own[..., 2] > 0.05 * self.exact_at
        own = np.where(ahead[..., None], own, np.array([0.0, 0.0, self.exact_at]))
        slopes = own[..., :2] / own[..., 2:] if camera.plate is None else camera.plate.slopes(own)
        x, y, _, _ = side.view.rectangle(self.frame_width, self.frame_height)
        w, h = side.view.upright_size(self.frame_width, self.frame_height)
        pixels = camera.lens.project_slopes(slopes) - np.array([x, y])
        within = np.all((pixels >= 0) & (pixels <= np.array([w - 1, h - 1])), axis=-1)
        inside = ahead & camera.lens.one_to_one(slopes) & within
        return np.where(inside[..., None], pixels, np.nan).astype(np.float32)

    def points_at(self, pixels: Array, depth: Array, side: RectifiedView) -> Array:
        """Return what rectified pixels (..., 2) of a view show at a depth (...): points (..., 3) of the left camera's frame."""
        slopes = (pixels - np.array([side.cx_px, self.cy_px])) / self.focal_px
        rays = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
        return np.asarray(side.pinhole + depth[..., None] * (rays @ side.R_rectified_from_left))

    def rectify(self, pixels: Array, side: RectifiedView) -> Array:
        """Take upright pixels (..., 2) of a view to rectified pixels (..., 2) of the same view."""
        origin, direction = side.camera.rays(pixels)
        begin = (origin - side.pinhole) @ side.R_rectified_from_left.T
        along = direction @ side.R_rectified_from_left.T
        reach = (self.exact_at - begin[..., 2:]) / along[..., 2:]
        flat = (begin + reach * along)[..., :2] / self.exact_at
        return np.asarray(self.focal_px * flat + np.array([side.cx_px, self.cy_px]))

    def points(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Take a depth map (height, width) to points (height, width, 3) of the rectified frame, in its unit."""
        columns, rows = np.meshgrid(np.arange(self.width), np.arange(self.height))
        x = (columns - self.left.cx_px) / self.focal_px * depth
        y = (rows - self.cy_px) / self.focal_px * depth
        return np.stack([x, y, depth], axis=-1).astype(np.float32)


def rectification(calibration: Calibration, wish: RangeWish | None = None, labels: int | None = None) -> Rectification:
    """Derive the rectification of a calibration for a wished range (default: the calibration's own, with its labels).

    The calibration's own range is its far end and its labels; the near end follows from them. With a wish but no `labels`,
    the search is as long as the range needs; `labels` alone go with the calibration's range.
    `UsageError` when it cannot be had.
    """
    pinholes = calibration.pinholes()
    turn = _turn(pinholes)
    focal_px = pinholes.focal_px
    scale = focal_px * pinholes.baseline
    asked = calibration.range if wish is None else wish
    if wish is None and labels is None:  # the unit's own range: a built unit's near end is where its labels end
        window = DisparityWindow.reaching(scale, asked.far_mm, asked.labels)
    else:
        window = DisparityWindow.between(scale, asked.near_mm, asked.far_mm, labels)
    cameras = (pinholes.left, pinholes.right)
    turns = (turn, turn @ pinholes.right.R_camera_from_left.T)
    spans = [
        _span(camera, view, R, focal_px, calibration)
        for camera, view, R in zip(cameras, calibration.views, turns, strict=True)
    ]
    sizes = [view.upright_size(calibration.frame_width, calibration.frame_height) for view in calibration.views]
    width = max(size[0] for size in sizes)
    height = max(size[1] * view.row_step for size, view in zip(sizes, calibration.views, strict=True))
    first = _first_column(spans[0][:2], spans[1][:2], width, window)
    cx = (-first, -first + window.offset_px)
    shift = calibration.nearest_pinholes().shift * np.array([0.0, 0.0, 1.0])
    left, right = (
        RectifiedView(own, view, turn, nearest.centre + shift, column)
        for own, view, nearest, column in zip(
            (calibration.left, calibration.right), calibration.views, cameras, cx, strict=True
        )
    )
    flat = Rectification(
        left=left,
        right=right,
        focal_px=focal_px,
        cy_px=(height - 1) / 2 - (spans[0][2] + spans[1][2]) / 2,
        width=width,
        height=height,
        frame_width=calibration.frame_width,
        frame_height=calibration.frame_height,
        window=window,
        unit=calibration.unit,
    )
    return flat if calibration.left.plate is None else _behind_glass(flat)


def _behind_glass(flat: Rectification) -> Rectification:
    """Return a rectification that is exact in the middle of its window, and knows what the glass does elsewhere."""
    window = flat.window
    exact = replace(flat, exact_at=window.scale_px / ((1 + window.labels - 2) / 2 + window.offset_px))
    columns, rows = np.meshgrid(
        np.linspace(0, flat.width - 1, _GLASS_GRID[0]), np.linspace(0, flat.height - 1, _GLASS_GRID[1])
    )
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)[:, None]
    ideal = np.linspace(1, window.labels - 2, _DEPTH_SAMPLES)
    depth = np.broadcast_to(
        window.scale_px / np.maximum(ideal + window.offset_px, _NEARLY_INFINITE), (len(pixels), len(ideal))
    )
    points = exact.points_at(pixels, depth, exact.left)
    seen = [side.camera.project(points) for side in (exact.left, exact.right)]
    found = [exact.rectify(pixels, side) for pixels, side in zip(seen, (exact.left, exact.right), strict=True)]
    both = _within(seen[0], exact.left, exact) & _within(seen[1], exact.right, exact)
    disparity = np.where(both, found[0][..., 0] - found[1][..., 0], np.nan)
    missing = ideal - disparity
    glass = GlassParallax.fitted(found[0], disparity, missing, (exact.width, exact.height), window.labels)
    return replace(exact, window=replace(window, glass=glass))


def _within(pixels: Array, side: RectifiedView, made: Rectification) -> NDArray[np.bool_]:
    """Tell which upright pixels (..., 2) lie in a view, or next to it."""
    x, y, _, _ = side.view.rectangle(made.frame_width, made.frame_height)
    w, h = side.view.upright_size(made.frame_width, made.frame_height)
    return np.asarray(
        np.all((pixels > [x - _NEXT_PX, y - _NEXT_PX]) & (pixels < [x + w + _NEXT_PX, y + h + _NEXT_PX]), axis=-1)
    )


def _middle_slopes(camera: Camera, view: View, calibration: Calibration) -> Array:
    """Return the slopes (3, 2) of the middles of a view's left border, of the view, and of its right border.

    Where the lens' polynomial folds before a border, of the outermost column that it still tells of.
    """
    x, y, _, _ = view.rectangle(calibration.frame_width, calibration.frame_height)
    w, h = view.upright_size(calibration.frame_width, calibration.frame_height)
    columns = x + (w - 1) * np.linspace(0, 1, 2 * _BORDER_STEPS + 1)
    slopes = camera.lens.slopes(np.stack([columns, np.full(len(columns), y + (h - 1) / 2)], axis=-1))
    told = np.flatnonzero(np.isfinite(slopes).all(axis=1))
    if _BORDER_STEPS not in told:
        raise CalibrationError(
            f"the distortion {camera.lens.distortion} folds the picture in the middle of a view: calibrate again with corners "
            "all over the view"
        )
    return np.asarray(slopes[[told[0], _BORDER_STEPS, told[-1]]])


def _turn(calibration: Calibration) -> Array:
    """Return R_rectified_from_left: rows are the rectified axes in the left camera's frame."""
    x = calibration.right.centre / calibration.baseline
    ahead = np.zeros(3)
    for camera, view in zip((calibration.left, calibration.right), calibration.views, strict=True):
        a, b = _middle_slopes(camera, view, calibration)[1]
        direction = camera.R_camera_from_left.T @ np.array([a, b, 1.0])
        ahead += direction / np.linalg.norm(direction)
    z = ahead - x * (ahead @ x)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _span(
    camera: Camera, view: View, R: Array, focal_px: float, calibration: Calibration
) -> tuple[float, float, float]:
    """Return where a view's left and right border lie in rectified columns from the z axis, and its middle row."""
    slopes = _middle_slopes(camera, view, calibration)
    direction = np.column_stack([slopes, np.ones(3)]) @ R.T
    flat = focal_px * direction[:, :2] / direction[:, 2:]
    return float(flat[0, 0]), float(flat[2, 0]), float(flat[1, 1])


def _first_column(left: tuple[float, float], right: tuple[float, float], width: int, window: DisparityWindow) -> float:
    """Choose the left picture's first column, from the z axis, so that most of the range window has a match in both.

    A point of parallax D lies at x in the left view and x - D in the right one; with the window's offset the right
    picture begins `offset` columns before the left one. Counted: columns x that lie in both views and both pictures.
    """
    parallax = np.linspace(1, window.labels - 2, _DEPTH_SAMPLES) + window.offset_px
    centred = (left[0] + left[1] + right[0] + right[1]) / 4 - width / 2
    candidates = centred + np.arange(-width, width + 1)
    begin, shift = candidates[:, None], -window.offset_px
    low = np.maximum.reduce(np.broadcast_arrays(begin, left[0], right[0] + parallax, begin + shift + parallax))
    high = np.minimum.reduce(
        np.broadcast_arrays(begin + width, left[1], right[1] + parallax, begin + shift + width + parallax)
    )
    common = np.maximum(high - low, 0).sum(axis=1)
    best = np.flatnonzero(common >= common.max() - 1e-9)
    return float(candidates[best[np.argmin(np.abs(candidates[best] - centred))]])
