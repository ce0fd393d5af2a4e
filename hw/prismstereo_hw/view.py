"""Which part of the raw frame a view fills, and how it stands in there.

`left` and `right` name the virtual viewpoints, never the image halves: behind a prism with its base to the lens the
RIGHT half of the frame is the LEFT view. A view may also be mirrored or turned; `cut` gives it upright.

Pixels. (0, 0) is the centre of the top-left pixel. *Upright* coordinates of a view are those of its cut-out picture
plus the corner of its rectangle, so an ordinary view has the coordinates of the raw frame itself.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import RigError, UsageError
from prismstereo_hw.lens import Lens

__all__ = ["LAYOUTS", "Side", "View", "layout", "read_layout"]

_MAX_FILE_BYTES = 64 * 1024

Side = Literal["left", "right"]


class View(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One view's rectangle, as fractions of the frame, and its attitude in there."""

    left: float  # edges of the rectangle, 0..1 of the frame's width and height
    top: float
    width: float
    height: float
    mirrored: bool = False  # left-right, after the turn
    turn_deg: Literal[0, 90, 180, 270] = 0  # counter-clockwise turn that makes the view upright
    row_start: int = 0  # of an interlaced view: its first row within the rectangle, and the step to its next
    row_step: int = 1
    exposure: int = 0  # of a view that is taken alone: which of the exposures stacked in a raw frame is its own
    exposures: int = 1

    polygon: tuple[tuple[float, float], ...] = ()  # corners within the frame, as fractions; empty: the whole rectangle

    def __post_init__(self) -> None:
        """Refuse a rectangle that leaves the frame, and rows or exposures that there are not."""
        inside = min(self.left, self.top) >= 0 and self.left + self.width <= 1 and self.top + self.height <= 1
        if not (inside and self.width > 0 and self.height > 0):
            raise RigError(
                f"view rectangle left {self.left}, top {self.top}, width {self.width}, height {self.height} leaves the "
                "frame: give fractions of the frame between 0 and 1"
            )
        if not (0 <= self.row_start < self.row_step <= 8 and 0 <= self.exposure < self.exposures <= 8):
            raise RigError(
                f"rows from {self.row_start} in steps of {self.row_step}, exposure {self.exposure} of {self.exposures}: give "
                "0 <= start < step <= 8 and 0 <= exposure < exposures <= 8"
            )
        if self.polygon and not (len(self.polygon) >= 3 and all(0 <= c <= 1 for point in self.polygon for c in point)):
            raise RigError(f"view polygon {self.polygon}: give three corners or more, as fractions between 0 and 1")

    def rectangle(self, frame_width: int, frame_height: int) -> tuple[int, int, int, int]:
        """Return x, y, width, height of this view in whole pixels of a frame of that size."""
        x, y = round(self.left * frame_width), round(self.top * frame_height)
        return (
            x,
            y,
            round((self.left + self.width) * frame_width) - x,
            round((self.top + self.height) * frame_height) - y,
        )

    def _rows(self, height: int) -> int:
        return -(-(height - self.row_start) // self.row_step)

    def upright_size(self, frame_width: int, frame_height: int) -> tuple[int, int]:
        """Return width and height of the upright picture cut from a frame of that size."""
        _, _, w, h = self.rectangle(frame_width, frame_height)
        h = self._rows(h)
        return (h, w) if self.turn_deg in (90, 270) else (w, h)

    def cut(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Cut this view out of a raw frame (height, width[, 3]) and set it upright; a view of the input where it can be.

        A raw frame of several exposures has them one below the other.
        """
        frame_height = pixels.shape[0] // self.exposures
        exposed = pixels[self.exposure * frame_height : (self.exposure + 1) * frame_height]
        x, y, w, h = self.rectangle(exposed.shape[1], frame_height)
        shown = exposed[y + self.row_start : y + h : self.row_step, x : x + w]
        upright = np.rot90(shown, self.turn_deg // 90)
        return upright[:, ::-1] if self.mirrored else upright

    def upright_from_raw(self, points: NDArray[np.float64], frame_width: int, frame_height: int) -> NDArray[np.float64]:
        """Take raw-frame points (..., 2) in pixels of their exposure to this view's upright coordinates."""
        x, y, w, h = self.rectangle(frame_width, frame_height)
        u, v, h = points[..., 0] - x, (points[..., 1] - y - self.row_start) / self.row_step, self._rows(h)
        for _ in range(self.turn_deg // 90):  # np.rot90: what stood at the right edge goes to the top
            u, v, w, h = v, w - 1 - u, h, w
        if self.mirrored:
            u = w - 1 - u
        return np.stack([u + x, v + y], axis=-1)

    def raw_from_upright(self, points: NDArray[np.float64], frame_width: int, frame_height: int) -> NDArray[np.float64]:
        """Take this view's upright coordinates (..., 2) back to raw-frame pixels of its exposure."""
        x, y, _, _ = self.rectangle(frame_width, frame_height)
        w, h = self.upright_size(frame_width, frame_height)
        u, v = points[..., 0] - x, points[..., 1] - y
        if self.mirrored:
            u = w - 1 - u
        for _ in range(self.turn_deg // 90):
            u, v, w, h = h - 1 - v, u, h, w
        return np.stack([u + x, v * self.row_step + self.row_start + y], axis=-1)

    def upright_lens(self, lens: Lens, frame_width: int, frame_height: int) -> Lens:
        """Return the raw-frame lens as this view's upright picture has it; `RigError` for a turned view."""
        if self.turn_deg:
            raise RigError(f"a view turned by {self.turn_deg} degrees has no lens of its own: turn the camera instead")
        x, y, w, _ = self.rectangle(frame_width, frame_height)
        step = self.row_step
        thinned = replace(lens, fy_px=lens.fy_px / step, cy_px=(lens.cy_px - y - self.row_start) / step + y)
        return thinned.mirrored(x + (w - 1) / 2) if self.mirrored else thinned

    def shows(self, points: NDArray[np.float64], frame_width: int, frame_height: int) -> NDArray[np.bool_]:
        """Tell which raw-frame points (..., 2) lie inside the view's polygon; without one, all do."""
        inside = np.zeros(points.shape[:-1], bool) if self.polygon else np.ones(points.shape[:-1], bool)
        corners = np.array(self.polygon).reshape(-1, 2) * [frame_width, frame_height] - 0.5
        x, y = points[..., 0], points[..., 1]
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if y0 != y1:  # even-odd rule: count the edges to the left of the point
                crosses = (y >= min(y0, y1)) & (y < max(y0, y1))
                inside ^= crosses & (x > x0 + (y - y0) / (y1 - y0) * (x1 - x0))
        return inside


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


def layout(name: str | Path) -> tuple[View, View]:
    """Return the left and the right view of a layout, by name or from a layout file (see `read_layout`).

    `UsageError` lists the names there are.
    """
    if str(name) in LAYOUTS:
        return LAYOUTS[str(name)]
    if Path(name).suffix.lower() == ".toml":
        left, right = read_layout(name)[:2]
        return left, right
    raise UsageError(
        f"there is no layout {str(name)!r}: choose one of {', '.join(LAYOUTS)}, name a layout file (TOML), or give a rig with "
        "--rig"
    )


def read_layout(path: str | Path) -> tuple[View, ...]:
    """Read where the views lie from a TOML file: a table [left], a table [right], and one more for every further view.

    Each table has the fields of `View`. Returned are left, right, and the others in the order of the file. `UsageError` for a
    file that cannot be read, `RigError` naming the table and the field for what is wrong in it.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            text = file.read(_MAX_FILE_BYTES + 1)
        if len(text) > _MAX_FILE_BYTES:
            raise UsageError(f"{path} has more than {_MAX_FILE_BYTES} bytes: a layout file has a few lines")
        tables = msgspec.toml.decode(text.decode("utf-8-sig"), type=dict[str, dict[str, Any]])
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}: name a layout file (TOML)") from error
    except msgspec.ValidationError as error:
        raise RigError(f"{path} is not a layout: {error}: give a table for each view, [left] and [right]") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RigError(f"{path} is not TOML: {error}") from error
    for side in ("left", "right"):
        if side not in tables:
            raise RigError(f"{path} has no table [{side}]: give left, top, width and height of both views")
    names = ["left", "right", *(name for name in tables if name not in ("left", "right"))]
    return tuple(_view(tables[name], f"{path}: [{name}]") for name in names)


def _view(table: dict[str, Any], origin: str) -> View:
    try:
        return msgspec.convert(table, View)
    except (msgspec.ValidationError, RigError) as error:
        raise RigError(f"{origin}: {error}") from error
