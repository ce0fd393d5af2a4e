"""Which part of the raw frame a view fills, and how it stands in there.

`left` and `right` name the virtual viewpoints, never the image halves: behind a prism with its base to the lens the
RIGHT half of the frame is the LEFT view. A view may also be mirrored or turned; `cut` gives it upright.

Pixels. (0, 0) is the centre of the top-left pixel. *Upright* coordinates of a view are those of its cut-out picture
plus the corner of its rectangle, so an ordinary view has the coordinates of the raw frame itself.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError, UsageError

__all__ = ["LAYOUTS", "Side", "View", "layout"]

Side = Literal["left", "right"]


class View(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One view's rectangle, as fractions of the frame, and its attitude in there."""

    left: float  # edges of the rectangle, 0..1 of the frame's width and height
    top: float
    width: float
    height: float
    mirrored: bool = False  # left-right, after the turn
    turn_deg: Literal[0, 90, 180, 270] = 0  # counter-clockwise turn that makes the view upright

    def __post_init__(self) -> None:
        """Refuse a rectangle that leaves the frame."""
        inside = min(self.left, self.top) >= 0 and self.left + self.width <= 1 and self.top + self.height <= 1
        if not (inside and self.width > 0 and self.height > 0):
            raise RigError(
                f"view rectangle left {self.left}, top {self.top}, width {self.width}, height {self.height} leaves the "
                "frame: give fractions of the frame between 0 and 1"
            )

    def rectangle(self, frame_width: int, frame_height: int) -> tuple[int, int, int, int]:
        """Return x, y, width, height of this view in whole pixels of a frame of that size."""
        x, y = round(self.left * frame_width), round(self.top * frame_height)
        return (
            x,
            y,
            round((self.left + self.width) * frame_width) - x,
            round((self.top + self.height) * frame_height) - y,
        )

    def upright_size(self, frame_width: int, frame_height: int) -> tuple[int, int]:
        """Return width and height of the upright picture cut from a frame of that size."""
        _, _, w, h = self.rectangle(frame_width, frame_height)
        return (h, w) if self.turn_deg in (90, 270) else (w, h)

    def cut(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Cut this view out of a frame (height, width[, 3]) and set it upright; a view of the input where it can be."""
        x, y, w, h = self.rectangle(pixels.shape[1], pixels.shape[0])
        upright = np.rot90(pixels[y : y + h, x : x + w], self.turn_deg // 90)
        return upright[:, ::-1] if self.mirrored else upright

    def upright_from_raw(self, points: NDArray[np.float64], frame_width: int, frame_height: int) -> NDArray[np.float64]:
        """Take raw-frame points (..., 2) in pixels to this view's upright coordinates."""
        x, y, w, h = self.rectangle(frame_width, frame_height)
        u, v = points[..., 0] - x, points[..., 1] - y
        for _ in range(self.turn_deg // 90):  # np.rot90: what stood at the right edge goes to the top
            u, v, w, h = v, w - 1 - u, h, w
        if self.mirrored:
            u = w - 1 - u
        return np.stack([u + x, v + y], axis=-1)

    def raw_from_upright(self, points: NDArray[np.float64], frame_width: int, frame_height: int) -> NDArray[np.float64]:
        """Take this view's upright coordinates (..., 2) back to raw-frame pixels."""
        x, y, _, _ = self.rectangle(frame_width, frame_height)
        w, h = self.upright_size(frame_width, frame_height)
        u, v = points[..., 0] - x, points[..., 1] - y
        if self.mirrored:
            u = w - 1 - u
        for _ in range(self.turn_deg // 90):
            u, v, w, h = h - 1 - v, u, h, w
        return np.stack([u + x, v + y], axis=-1)


_LEFT_HALF = View(left=0.0, top=0.0, width=0.5, height=1.0)
_RIGHT_HALF = View(left=0.5, top=0.0, width=0.5, height=1.0)
_TOP_HALF = View(left=0.0, top=0.0, width=1.0, height=0.5)
_BOTTOM_HALF = View(left=0.0, top=0.5, width=1.0, height=0.5)

LAYOUTS: dict[str, tuple[View, View]] = {  # name -> (left view, right view)
    "side-by-side": (_LEFT_HALF, _RIGHT_HALF),
    "swapped": (_RIGHT_HALF, _LEFT_HALF),
    "top-bottom": (_TOP_HALF, _BOTTOM_HALF),
    "bottom-top": (_BOTTOM_HALF, _TOP_HALF),
}


def layout(name: str) -> tuple[View, View]:
    """Return the left and the right view of a layout by name; `UsageError` lists the names there are."""
    if name not in LAYOUTS:
        raise UsageError(f"there is no layout {name!r}: choose one of {', '.join(LAYOUTS)}, or give a rig with --rig")
    return LAYOUTS[name]
