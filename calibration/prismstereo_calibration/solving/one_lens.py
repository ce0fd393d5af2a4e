"""The one-lens model: all views through ONE lens of five numbers, f, cx, cy, k1, k2 in raw-frame pixels.

A lens that bends more asks for three numbers more, p1, p2, k3; glass before it adds none, its plate is known.

It says what the instrument is, so it needs half the parameters of two cameras and finds the principal point several
times better (reference: optics, calibration). A mirrored view sees the lens mirrored about the middle column of its
rectangle, an interlaced one sees it with fewer rows (`View.upright_lens`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.plate import Plate
from prismstereo_calibration.solving.bundle import LensModel
from prismstereo_calibration.solving.first_guess import FEWEST_TO_GUESS, guess_lens, spread
from prismstereo_calibration.solving.projection import numbers_of
from prismstereo_hw.errors import UsageError
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

__all__ = ["model", "seed"]

Array = NDArray[np.float64]
_FEWEST_FRAMES = 2
_RADIAL, _FULL = 5, 8  # f, cx, cy, k1, k2; then p1, p2, k3
_SEED_FRAMES = 12


def model(
    views: tuple[View, ...], frame_width: int, frame_height: int, *, plate: Plate | None = None, full: bool = False
) -> LensModel:
    """Return how the views' lenses follow from f, cx, cy, k1, k2 (`full`: and p1, p2, k3); `UsageError` for a turned view."""
    for index, view in enumerate(views):
        if view.turn_deg:
            side = ("the left view", "the right view")[index] if index < 2 else f"view {index + 1}"
            raise UsageError(
                f"{side} is turned by {view.turn_deg} degrees, but the one-lens model takes upright and mirrored "
                "views: pass --model two-camera"
            )
    count = _FULL if full else _RADIAL
    upright = [_upright(view, frame_width, frame_height, count) for view in views]
    matrices, constants = zip(*upright, strict=True)
    return LensModel("one-lens", matrices, constants, fewest_frames=_FEWEST_FRAMES, plate=plate)


def _raw(own: Array) -> Lens:
    """Return the raw-frame lens of f, cx, cy, k1, k2, and of p1, p2, k3 if they are there."""
    f, cx, cy, *distortion = (float(number) for number in own)
    k1, k2, p1, p2, k3 = (*distortion, 0.0, 0.0, 0.0)[:5]
    return Lens(f, f, cx, cy, (k1, k2, p1, p2, k3))


def _upright(view: View, frame_width: int, frame_height: int, count: int) -> tuple[Array, Array]:
    """Return matrix (9, count) and constant (9,) of a view's lens: what standing in the frame as it does makes of the lens."""

    def numbers(own: Array) -> Array:
        return numbers_of(view.upright_lens(_raw(own), frame_width, frame_height))

    constant = numbers(np.zeros(count))
    return np.stack([numbers(unit) - constant for unit in np.eye(count)], axis=1), constant


def seed(points: Array, pixels: Array, views: tuple[View, ...], frame_width: int, frame_height: int) -> Array:
    """Return f, cx, cy, k1, k2 to start from where no rig tells them.

    All views are pictures taken by the one lens: those of a mirrored view show the board's mirror image. `pixels` are
    (V, K, N, 2) upright, NaN where unseen.
    """
    chosen = spread(len(pixels), _SEED_FRAMES)
    boards: list[Array] = []
    images: list[Array] = []
    for side, view in enumerate(views):
        board = points * np.array([-1.0, 1.0, 1.0]) if view.mirrored else points
        for frame in pixels[chosen, side]:
            shown = np.isfinite(frame).all(axis=-1)
            if np.count_nonzero(shown) >= FEWEST_TO_GUESS:
                boards.append(board[shown])
                images.append(view.raw_from_upright(frame[shown], frame_width, frame_height))
    lens = guess_lens(boards, images, (frame_width, frame_height), "the views")
    return np.array([lens.fx_px, lens.cx_px, lens.cy_px, *lens.distortion[:2]])
