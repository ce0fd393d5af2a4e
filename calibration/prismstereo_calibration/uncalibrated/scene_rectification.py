"""A rectification without scale: two homographies, found from a scene. It gives disparities and no millimetres.

`left` and `right` are the virtual viewpoints. Pixels of a view are its upright coordinates (its cut-out picture's, plus the
corner of its rectangle, see `prismstereo_hw.view`); (0, 0) of a rectified picture is the centre of its top-left pixel.
The window has labels and no scale, so that asking it for depth is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.uncalibrated.epipolar import mapped
from prismstereo_calibration.uncalibrated.form_figures import Form, FormFigures
from prismstereo_calibration.window import DisparityWindow
from prismstereo_hw.view import View

__all__ = ["SceneRectification", "SceneView"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SceneView:
    """One view, and the homography (3, 3) that takes its upright pixels to rectified ones."""

    view: View
    H_rectified_from_upright: Array


@dataclass(frozen=True, slots=True)
class SceneRectification:
    """Both views' homographies, the rectified pictures' size, and how it was chosen.

    `scale`: of the rectified pictures to the raw ones. `figures`: of every form that was tried, on held-back matches;
    `form` is the one that was taken, `reason` says why. `matches`: how many there were in all.
    """

    left: SceneView
    right: SceneView
    width: int
    height: int
    frame_width: int
    frame_height: int
    window: DisparityWindow
    scale: float
    form: Form
    reason: str
    figures: tuple[FormFigures, ...]
    matches: int
    rig: str = ""

    @property
    def views(self) -> tuple[View, View]:
        """The left and the right view of the raw frame."""
        return self.left.view, self.right.view

    @property
    def chosen(self) -> FormFigures:
        """The figures of the form that was taken."""
        return next(one for one in self.figures if one.form == self.form)

    def sources(self, side: SceneView) -> NDArray[np.float32]:
        """Return, for every rectified pixel, the pixel (height, width, 2) of the upright cut-out view; NaN outside of it."""
        columns, rows = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        x, y, _, _ = side.view.rectangle(self.frame_width, self.frame_height)
        w, h = side.view.upright_size(self.frame_width, self.frame_height)
        back = np.linalg.inv(side.H_rectified_from_upright)
        ahead = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ back.T
        in_front = ahead[..., 2] * self._sign(side) > 0  # the rest is behind the camera and would show upside down
        upright = ahead[..., :2] / np.where(in_front, ahead[..., 2], 1.0)[..., None]
        pixels = upright - np.array([x, y])
        inside = in_front & np.all((pixels >= 0) & (pixels <= np.array([w - 1, h - 1])), axis=-1)
        if side.view.polygon:
            raw = side.view.raw_from_upright(upright, self.frame_width, self.frame_height)
            inside &= side.view.shows(raw, self.frame_width, self.frame_height)
        return np.where(inside[..., None], pixels, np.nan).astype(np.float32)

    def rectify(self, pixels: Array, side: SceneView) -> Array:
        """Take upright pixels (..., 2) of a view to rectified pixels (..., 2) of the same view."""
        return mapped(side.H_rectified_from_upright, pixels)

    def _sign(self, side: SceneView) -> float:
        """Return the sign that the third coordinate of what the view shows has on the way back."""
        x, y, _, _ = side.view.rectangle(self.frame_width, self.frame_height)
        w, h = side.view.upright_size(self.frame_width, self.frame_height)
        middle = np.array([x + (w - 1) / 2, y + (h - 1) / 2, 1.0])
        # H takes the middle to t (x', y', 1), its inverse (x', y', 1) to the middle over t
        return float(np.sign(side.H_rectified_from_upright[2] @ middle))
