"""Which view each pixel of the raw frame belongs to, and which get no light at all.

A pixel belongs to the view through whose surfaces its ray, from the middle of the pupil, comes out. What a view sees is
bounded by a few smooth curves, so rays are traced on a coarse grid first, and pixel by pixel only where neighbours of the
grid disagree.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.view import Side

__all__ = ["SIDES", "coverage", "hidden_last", "own_rows"]

SIDES: tuple[Side, Side] = ("left", "right")
_CELL_PX = 8
_AT_ONCE = 1 << 16  # rays traced in one go, so that memory stays small


def hidden_last(rig: Rig) -> list[int]:
    """Return the numbers of the views, 0 left and 1 right, in the order in which they get a ray.

    A direct view is blocked by the mirror of the other one, so whoever meets more surfaces comes first.
    """
    return sorted((0, 1), key=lambda number: -len(rig.surfaces(SIDES[number])))


def own_rows(rig: Rig, number: int, exposure: int, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell which rows (N,) of an exposure are a view's own."""
    view = rig.views[number]
    return np.asarray((rows % view.row_step == view.row_start) & (view.exposure == exposure))


@lru_cache(maxsize=4)  # half of a frame's work, and the same before every scene
def coverage(rig: Rig, mode: Mode) -> NDArray[np.int8]:
    """Trace which view each pixel of each exposure belongs to.

    Read-only, (exposures, height, width): 0 left, 1 right, -1 no light.
    """
    found = np.full((rig.views[0].exposures, mode.height, mode.width), -1, np.int8)
    rows = np.arange(mode.height)
    for number in hidden_last(rig):
        lit = _lit(rig, SIDES[number], mode)
        for exposure, seen_by in enumerate(found):
            mine = lit & own_rows(rig, number, exposure, rows)[:, None]
            seen_by[mine & (seen_by < 0)] = number
    found.flags.writeable = False
    return found


def _lit(rig: Rig, side: Side, mode: Mode) -> NDArray[np.bool_]:
    """Tell for every pixel (height, width) whether its ray comes out through a view's surfaces."""
    across, down = (np.append(np.arange(0, n - 1, _CELL_PX), n - 1) for n in (mode.width, mode.height))
    coarse = _comes_through(rig, side, mode, *np.meshgrid(across, down)).reshape(len(down), len(across))
    corners = np.stack([coarse[:-1, :-1], coarse[:-1, 1:], coarse[1:, :-1], coarse[1:, 1:]])
    mixed = np.asarray(corners.any(axis=0) & ~corners.all(axis=0), np.uint8)
    doubtful = cv2.dilate(mixed, np.ones((3, 3), np.uint8)).astype(bool)  # curves may bulge into the next cell
    tall, wide = np.diff(down), np.diff(across)
    tall[-1], wide[-1] = tall[-1] + 1, wide[-1] + 1  # the last cells have the last row and column too
    lit = _spread(corners[0], tall, wide)
    rows, columns = np.nonzero(_spread(doubtful, tall, wide))
    lit[rows, columns] = _comes_through(rig, side, mode, columns, rows)
    return lit


def _spread(cells: NDArray[np.bool_], tall: NDArray[np.intp], wide: NDArray[np.intp]) -> NDArray[np.bool_]:
    return np.repeat(np.repeat(cells, tall, axis=0), wide, axis=1)


def _comes_through(
    rig: Rig, side: Side, mode: Mode, columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[np.bool_]:
    lens, pixels = rig.lens(mode), np.stack([columns.ravel(), rows.ravel()], axis=-1)
    pieces = [pixels[begin : begin + _AT_ONCE] for begin in range(0, len(pixels), _AT_ONCE)]
    fates = [view_fates(rig, side, lens.slopes(piece.astype(float))).fate for piece in pieces]
    return np.concatenate(fates) == 0 if fates else np.zeros(0, bool)
