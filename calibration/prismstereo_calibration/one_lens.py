"""The one-lens model: both views through ONE lens of five numbers, f, cx, cy, k1, k2 in raw-frame pixels.

It says what the instrument is, so it needs half the parameters of two cameras and finds the principal point several
times better (reference: optics, calibration). A mirrored view sees the lens mirrored about the middle column of its
rectangle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.bundle import LensModel
from prismstereo_calibration.first_guess import guess_lens, spread
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

__all__ = ["model", "own_numbers", "seed"]

Array = NDArray[np.float64]
_FEWEST_FRAMES = 2
_SEED_FRAMES = 12


def model(views: tuple[View, View], frame_width: int, frame_height: int) -> LensModel:
    """Return how both views' lenses follow from f, cx, cy, k1, k2; `UsageError` for a turned view."""
    matrices, constants = [], []
    for side, view in zip(("left", "right"), views, strict=True):
        if view.turn_deg:
            raise UsageError(
                f"the {side} view is turned by {view.turn_deg} degrees, but the one-lens model takes upright and mirrored "
                "views: pass --model two-camera"
            )
        x, _, width, _ = view.rectangle(frame_width, frame_height)
        matrix, constant = np.zeros((9, 5)), np.zeros(9)
        matrix[[0, 1, 2, 3, 4, 5], [0, 0, 1, 2, 3, 4]] = 1.0
        if view.mirrored:  # cx of the picture mirrored about x + (width - 1) / 2
            matrix[2, 1], constant[2] = -1.0, 2 * x + width - 1
        matrices.append(matrix)
        constants.append(constant)
    return LensModel("one-lens", matrices[0], constants[0], matrices[1], constants[1], _FEWEST_FRAMES)


def own_numbers(lens: Lens) -> Array:
    """Return f, cx, cy, k1, k2 (5,) of a raw-frame lens."""
    return np.array([lens.fx_px, lens.cx_px, lens.cy_px, lens.distortion[0], lens.distortion[1]])


def seed(points: Array, pixels: Array, views: tuple[View, View], frame_width: int, frame_height: int) -> Array:
    """Return f, cx, cy, k1, k2 to start from where no rig tells them.

    Both views are pictures taken by the one lens: those of a mirrored view show the board's mirror image. `pixels` are
    (V, 2, N, 2) upright.
    """
    chosen = spread(len(pixels), _SEED_FRAMES)
    boards: list[Array] = []
    images: list[Array] = []
    for side, view in enumerate(views):
        board = points * np.array([-1.0, 1.0, 1.0]) if view.mirrored else points
        boards += [board] * len(chosen)
        images += list(view.raw_from_upright(pixels[chosen, side], frame_width, frame_height))
    return own_numbers(guess_lens(boards, images, (frame_width, frame_height), "the views"))
