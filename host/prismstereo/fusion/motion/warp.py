"""Show the still as a model says the frame sees it: coordinates on the video's lattice, interpolated to any resolution."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.motion.models import FlatMotion, MotionModel
from prismstereo.fusion.motion.picture import HALF_STEP, enlarged

__all__ = ["Box", "box_of", "places_in_still", "shown", "shown_fine", "shown_low"]

Float = NDArray[np.float32]
Mask = NDArray[np.bool_]
Matrix = NDArray[np.float64]
Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of video pixels: columns left .. right - 1, rows top .. bottom - 1."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.bottom - self.top, self.right - self.left

    @property
    def cut(self) -> tuple[slice, slice]:
        """The slices that cut it out of a picture."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def empty(self) -> bool:
        """Tell whether nothing is in it."""
        return self.right - self.left < 8 or self.bottom - self.top < 8


def box_of(mask: Mask, model: MotionModel, room: int, frame_changed: Mask) -> Box:
    """Return the part of the frame in which a model shows what `mask` (height, width) holds of the still, and some room."""
    height, width = mask.shape
    if isinstance(model, FlatMotion):
        rows, columns = np.nonzero(mask)
        corners = np.array(
            [[x, y] for x in (columns.min(), columns.max()) for y in (rows.min(), rows.max())], np.float64
        )
        moved = model.in_frame(corners)
    else:  # a motion in space is known from the frame to the still only
        rows, columns = np.nonzero(frame_changed)
        moved = np.column_stack([columns, rows]).astype(np.float64) if rows.size else np.zeros((1, 2))
    low, high = np.floor(moved.min(axis=0)) - room, np.ceil(moved.max(axis=0)) + room + 1
    low, high = np.clip(low, 0, [width, height]), np.clip(high, 0, [width, height])
    return Box(int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def places_in_still(model: MotionModel, box: Box) -> Float:
    """Return where in the still each video pixel of a box lies, (rows, columns, 2) float32; far outside where not known."""
    columns, rows = np.meshgrid(
        np.arange(box.left, box.right, dtype=float), np.arange(box.top, box.bottom, dtype=float)
    )
    found = model.in_still(np.stack([columns.ravel(), rows.ravel()], axis=-1))
    return np.nan_to_num(found, nan=-1e4).astype(np.float32).reshape(*box.shape, 2)


def shown(pixels: Picture, places: Float, from_low: Matrix, to: tuple[Matrix, tuple[int, int]], flags: int) -> Picture:
    """Show a picture at places (rows, columns, 2) in video pixels of the still, on a lattice finer than the places'.

    `from_low` (3, 3) takes those to the picture's pixels. `to` is the matrix (3, 3) from the places' lattice to the shown
    picture's pixels, and the size (width, height) of that. Outside of the picture it is black.
    """
    to_shown, size = to
    lattice = np.linalg.inv(to_shown)[:2]
    # one more row and column on each side, continued: the rim of the shown picture lies beyond the outermost places
    wide = np.pad(places, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    lattice[:, 2] += 1
    fine = cv2.warpAffine(
        wide, lattice, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )
    x = from_low[0, 0] * fine[..., 0] + np.float32(from_low[0, 2])
    y = from_low[1, 1] * fine[..., 1] + np.float32(from_low[1, 2])
    return np.asarray(
        cv2.remap(pixels, x.astype(np.float32), y.astype(np.float32), flags, borderMode=cv2.BORDER_CONSTANT), np.uint8
    )


def shown_fine(fine: Picture, places: Float) -> Picture:
    """Show a picture of two pixels for one of the video, at the same fineness."""
    M = enlarged(HALF_STEP)
    rows, columns = places.shape[:2]
    return shown(fine, places, M, (M, (columns * HALF_STEP, rows * HALF_STEP)), cv2.INTER_CUBIC)


def shown_low(mask: Mask, places: Float) -> Mask:
    """Show a mask of the still, in video pixels, where the frame has it."""
    found = cv2.remap(mask.astype(np.float32), places[..., 0], places[..., 1], cv2.INTER_LINEAR)
    return np.asarray(found > 0.5)
