"""The two-camera model: each view its own lens of nine numbers, for any layout, for two lenses, and for comparison.

It starts from a guess of each view alone and is refined jointly; the optimum is that of `cv2.stereoCalibrate`.
Pixels are upright full-frame coordinates, so the principal point of a right half counts from the frame's left edge.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.solving import one_lens
from prismstereo_calibration.solving.bundle import LensModel
from prismstereo_calibration.solving.first_guess import FEWEST_TO_GUESS, guess_lens, spread
from prismstereo_calibration.solving.projection import LENS_NUMBERS, numbers_of
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

__all__ = ["model", "seeds"]

Array = NDArray[np.float64]
_FEWEST_FRAMES = 3
_RADIAL = 6  # fx, fy, cx, cy, k1, k2
_SEED_FRAMES = 20


def model(views: int = 2, *, full: bool = True) -> LensModel:
    """Return how the lenses follow from nine numbers each, in the order of the views; of six if not `full`: no p1, p2, k3."""
    own = np.eye(LENS_NUMBERS)[:, : LENS_NUMBERS if full else _RADIAL]
    blocks = np.split(np.kron(np.eye(views), own), views)
    return LensModel("two-camera", tuple(blocks), (np.zeros(LENS_NUMBERS),) * views, _FEWEST_FRAMES)


def settled(
    points: Array, pixels: Array, views: tuple[View, ...], frame_width: int, frame_height: int, *, plain: bool
) -> LensModel:
    """Return the model whose lenses are those of each view alone, for good: only the poses are left to solve for.

    This is for views that were not taken at quite the same moment: the common fit would bend the lenses to make up for it.
    """
    size = (frame_width, frame_height)
    lenses = [numbers_of(_alone(points, pixels[:, side], view, size, plain=plain)) for side, view in enumerate(views)]
    return LensModel("two-camera", (np.zeros((LENS_NUMBERS, 0)),) * len(views), tuple(lenses), _FEWEST_FRAMES)


def seeds(
    model: LensModel, points: Array, pixels: Array, views: tuple[View, ...], frame_width: int, frame_height: int
) -> tuple[Array, ...]:
    """Return a model's numbers to start from; `pixels` are (V, K, N, 2) upright, NaN where unseen.

    Each view alone, with all its numbers and with few; and both as pictures of one lens, which they are behind a prism:
    there the principal point stands at the very border of a view, and a view alone may not find it.
    """
    size = (frame_width, frame_height)
    found: list[Array] = []
    failure: CalibrationError | None = None
    for plain in (False, True):
        try:
            alone = [_alone(points, pixels[:, side], view, size, plain=plain) for side, view in enumerate(views)]
        except CalibrationError as error:
            failure = error
        else:
            found.append(model.own(*alone))
    if not any(view.turn_deg for view in views):
        with contextlib.suppress(CalibrationError):
            shared = one_lens.seed(points, pixels, views, frame_width, frame_height)
            lenses = one_lens.model(views, frame_width, frame_height).lenses(shared)
            found.append(model.own(*lenses))
    if not found and failure is not None:
        raise failure
    return tuple(found)


def _alone(points: Array, pixels: Array, view: View, frame: tuple[int, int], *, plain: bool) -> Lens:
    """Guess a view's lens on its cut-out picture, whose middle is the guess of the principal point."""
    shown = np.asarray(np.isfinite(pixels).all(axis=-1))
    enough = np.flatnonzero(np.count_nonzero(shown, axis=1) >= FEWEST_TO_GUESS)
    chosen = enough[spread(len(enough), _SEED_FRAMES)] if enough.size else enough
    corner = np.array(view.rectangle(*frame)[:2], np.float64)
    boards = [points[shown[i]] for i in chosen]
    images = [pixels[i][shown[i]] - corner for i in chosen]
    lens = guess_lens(boards, images, view.upright_size(*frame), "the views", plain=plain)
    return replace(lens, cx_px=lens.cx_px + float(corner[0]), cy_px=lens.cy_px + float(corner[1]))
