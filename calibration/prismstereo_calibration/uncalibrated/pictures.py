"""What is known of the two views as pictures before any match: sizes, and where the lens axis meets them.

Behind one lens both views share its axis, which stands where it does in the raw frame: at the inner border of the halves of
a prism rig, outside of a mirrored view even. Two cameras side by side have it in the middle of each view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

__all__ = ["ViewPictures"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ViewPictures:
    """The views of a raw frame (height of one exposure), and the lens axis (2, 2) in upright pixels, left view first."""

    views: tuple[View, View]
    frame_width: int
    frame_height: int
    principal_points: Array
    one_lens: bool

    @classmethod
    def of(
        cls, views: tuple[View, View], frame_width: int, frame_height: int, lens: Lens | None = None,
        *, one_lens: bool | None = None,
    ) -> ViewPictures:  # fmt: skip
        """Place the lens axis in both views.

        It is that of a known `lens` in raw-frame pixels, the frame's middle for one lens of which nothing is known, or else
        the middle of each view. Whether there is one lens is taken from there being a known one, or a mirrored view, unless
        it is said.
        """
        if one_lens is None:
            one_lens = lens is not None or any(view.mirrored for view in views)
        frame = frame_width, frame_height
        if one_lens:
            middle = np.array([(frame_width - 1) / 2, (frame_height - 1) / 2])
            axis = middle if lens is None else np.array([lens.cx_px, lens.cy_px])
            points = [view.upright_from_raw(axis, *frame) for view in views]
        else:
            points = [_corner(view, *frame) + (np.array(view.upright_size(*frame)) - 1) / 2 for view in views]
        return cls(views, *frame, np.stack(points), one_lens)

    @property
    def sizes(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Width and height of both upright pictures."""
        left, right = (view.upright_size(self.frame_width, self.frame_height) for view in self.views)
        return left, right

    @property
    def row_steps(self) -> tuple[int, int]:
        """How many rows of the sensor one row of each picture stands for."""
        return self.views[0].row_step, self.views[1].row_step

    @property
    def width(self) -> int:
        """Width of the wider picture."""
        return max(width for width, _ in self.sizes)

    @property
    def height(self) -> int:
        """Height of the taller picture, left-out rows counted."""
        return max(h * step for (_, h), step in zip(self.sizes, self.row_steps, strict=True))

    @property
    def camera_width(self) -> int:
        """Width of what one camera sees: of the raw frame behind one lens, else of a view."""
        return self.frame_width if self.one_lens else self.width

    def corners(self, side: int) -> Array:
        """Return the corners (4, 2) of a view's picture in upright pixels: top left, top right, bottom right, bottom left."""
        w, h = self.sizes[side]
        box = np.array([[0, 0], [w - 1, 0], [w - 1, h - 1], [0, h - 1]], float)
        return box + _corner(self.views[side], self.frame_width, self.frame_height)


def _corner(view: View, frame_width: int, frame_height: int) -> Array:
    """Return the upright coordinates (2,) of a cut-out picture's first pixel."""
    x, y, _, _ = view.rectangle(frame_width, frame_height)
    return np.array([x, y], float)
