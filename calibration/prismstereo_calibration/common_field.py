"""The common field: which pixels of a view the other view sees too, at some depth of the range window.

A pixel's ray leaves a line of pixels in the other view, one for each depth. It is in the common field when any of them lies
in the other view's rectangle (and polygon). The borders of the field are smooth, so rays are followed on a coarse grid
first, and pixel by pixel only where neighbours of the grid disagree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.camera import Camera
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_hw.view import Side, View

__all__ = ["SIDES", "common_field", "raw_pixels"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SIDES: tuple[Side, Side] = ("left", "right")
_CELL_PX = 8
_DEPTHS = 33  # along the range window, evenly in disparity
_AT_ONCE = 1 << 13  # rays followed in one go, so that memory stays small
_INFINITY = 1e9  # as good as infinitely far, in mm and in squares


def common_field(calibration: Calibration, side: Side, hidden: Mask | None = None) -> Mask:
    """Tell which pixels (height, width) of a view's upright picture the other view sees at some depth of the range.

    `hidden` (height, width) are pixels of the OTHER view's upright picture that see nothing of their own.
    """
    sight = _Sight.of(calibration, side, hidden)
    view = calibration.views[SIDES.index(side)]
    x, y, _, _ = view.rectangle(calibration.frame_width, calibration.frame_height)
    w, h = view.upright_size(calibration.frame_width, calibration.frame_height)
    across, down = (np.append(np.arange(0, n - 1, _CELL_PX), n - 1) for n in (w, h))
    coarse = sight.meets(np.stack(np.meshgrid(across + x, down + y), axis=-1).reshape(-1, 2).astype(float))
    coarse = coarse.reshape(len(down), len(across))
    corners = np.stack([coarse[:-1, :-1], coarse[:-1, 1:], coarse[1:, :-1], coarse[1:, 1:]])
    doubtful = _grown(
        np.asarray(corners.any(axis=0) & ~corners.all(axis=0))
    )  # a smooth border may bulge into the next cell
    tall, wide = np.diff(down), np.diff(across)
    tall[-1], wide[-1] = tall[-1] + 1, wide[-1] + 1  # the last cells have the last row and column too
    seen = _spread(corners[0], tall, wide)
    rows, columns = np.nonzero(_spread(doubtful, tall, wide))
    seen[rows, columns] = sight.meets(np.column_stack([columns + x, rows + y]).astype(float))
    return seen


def raw_pixels(view: View, frame_width: int, frame_height: int) -> NDArray[np.intp]:
    """Return the raw column and row (height, width, 2), within its exposure, of each pixel of a view's upright picture."""
    x, y, _, _ = view.rectangle(frame_width, frame_height)
    w, h = view.upright_size(frame_width, frame_height)
    upright = np.stack(np.meshgrid(np.arange(x, x + w, dtype=float), np.arange(y, y + h, dtype=float)), axis=-1)
    return np.rint(view.raw_from_upright(upright, frame_width, frame_height)).astype(np.intp)


@dataclass(frozen=True, slots=True)
class _Sight:
    """One view's rays, and what of them the other view sees."""

    own: Camera
    other: Camera
    other_view: View
    frame_width: int
    frame_height: int
    ahead: Array  # the rectified z axis, along which depth counts,
    begin: float  # and where on it depth begins
    depths: Array
    hidden: Mask | None

    @classmethod
    def of(cls, calibration: Calibration, side: Side, hidden: Mask | None) -> _Sight:
        calibration = (
            calibration.pinholes()
        )  # what glass bends differently is less than a pixel, and a border has no more
        rectified = rectification(calibration)
        window = rectified.window
        far = 0.0 if math.isinf(window.farthest) else 1 / window.farthest
        cameras = calibration.left, calibration.right
        own = SIDES.index(side)
        return cls(
            own=cameras[own],
            other=cameras[1 - own],
            other_view=calibration.views[1 - own],
            frame_width=calibration.frame_width,
            frame_height=calibration.frame_height,
            ahead=rectified.left.R_rectified_from_left[2],
            begin=float(rectified.left.pinhole @ rectified.left.R_rectified_from_left[2]),
            depths=1 / np.maximum(np.linspace(far, 1 / window.nearest, _DEPTHS), 1 / _INFINITY),
            hidden=hidden,
        )

    def meets(self, pixels: Array) -> Mask:
        """Tell which upright pixels (N, 2) of the own view the other view sees at any depth."""
        pieces = [pixels[begin : begin + _AT_ONCE] for begin in range(0, len(pixels), _AT_ONCE)]
        return np.concatenate([self._seen(piece) for piece in pieces]) if pieces else np.zeros(0, bool)

    def _seen(self, pixels: Array) -> Mask:
        origin, direction = self.own.rays(pixels)
        reach = (self.begin + self.depths - (origin @ self.ahead)[:, None]) / (direction @ self.ahead)[:, None]
        points = origin[:, None] + reach[..., None] * direction[:, None]
        found = self.other.project(points)
        local = points @ self.other.R_camera_from_left.T + self.other.t_camera_from_left
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = local[..., :2] / local[..., 2:]
        # beyond the fold of its distortion polynomial a lens would seem to see what it does not
        seen = (reach > 0) & (local[..., 2] > 0) & self.other.lens.one_to_one(slopes) & self._shown(found)
        return np.asarray(seen.any(axis=1))

    def _shown(self, pixels: Array) -> Mask:
        """Tell which upright pixels (..., 2) of the other view show something."""
        view, size = self.other_view, (self.frame_width, self.frame_height)
        x, y, _, _ = view.rectangle(*size)
        w, h = view.upright_size(*size)
        places = pixels - np.array([x, y])
        inside = np.all((places >= 0) & (places <= np.array([w - 1, h - 1])), axis=-1)  # NaN is nowhere
        if view.polygon:
            inside &= view.shows(view.raw_from_upright(pixels, *size), *size)
        if self.hidden is not None:
            nearest = np.rint(places[inside]).astype(np.intp)
            inside[inside] = ~self.hidden[nearest[:, 1], nearest[:, 0]]
        return np.asarray(inside)


def _spread(cells: Mask, tall: NDArray[np.intp], wide: NDArray[np.intp]) -> Mask:
    return np.repeat(np.repeat(cells, tall, axis=0), wide, axis=1)


def _grown(cells: Mask) -> Mask:
    """Return cells (rows, columns) and all their neighbours."""
    padded = np.pad(cells, 1)
    rows, columns = cells.shape
    return np.asarray(np.any([padded[r : r + rows, c : c + columns] for r in range(3) for c in range(3)], axis=0))
