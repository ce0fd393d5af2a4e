"""The one-lens model: both views through ONE lens of five numbers, f, cx, cy, k1, k2 in raw-frame pixels.

It says what the instrument is, so it needs half the parameters of two cameras and finds the principal point several
times better (reference: optics, calibration). A mirrored view sees the lens mirrored about the middle column of its
rectangle, an interlaced one sees it with fewer rows (`View.upright_lens`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.bundle import LensModel
from prismstereo_calibration.first_guess import guess_lens, spread
from prismstereo_calibration.projection import numbers_of
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

__all__ = ["model", "seed"]

Array = NDArray[np.float64]
_FEWEST_FRAMES = 2
_OWN_NUMBERS = 5
_SEED_FRAMES = 12


def model(views: tuple[View, View], frame_width: int, frame_height: int) -> LensModel:
    """Return how both views' lenses follow from f, cx, cy, k1, k2; `UsageError` for a turned view."""
    for side, view in zip(("left", "right"), views, strict=True):
        if view.turn_deg:
            raise UsageError(
                f"the {side} view is turned by {view.turn_deg} degrees, but the one-lens model takes upright and mirrored "
                "views: pass --model two-camera"
            )
    left, right = (_upright(view, frame_width, frame_height) for view in views)
    return LensModel("one-lens", *left, *right, fewest_frames=_FEWEST_FRAMES)


def _raw(own: Array) -> Lens:
    """Return the raw-frame lens of f, cx, cy, k1, k2."""
    f, cx, cy, k1, k2 = (float(number) for number in own)
    return Lens(f, f, cx, cy, (k1, k2, 0.0, 0.0, 0.0))


def _upright(view: View, frame_width: int, frame_height: int) -> tuple[Array, Array]:
    """Return matrix (9, 5) and constant (9,) of a view's lens: what standing in the frame as it does makes of the lens."""

    def numbers(own: Array) -> Array:
        return numbers_of(view.upright_lens(_raw(own), frame_width, frame_height))

    constant = numbers(np.zeros(_OWN_NUMBERS))
    return np.stack([numbers(unit) - constant for unit in np.eye(_OWN_NUMBERS)], axis=1), constant


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
    lens = guess_lens(boards, images, (frame_width, frame_height), "the views")
    return np.array([lens.fx_px, lens.cx_px, lens.cy_px, *lens.distortion[:2]])
