"""The two-camera model: each view its own lens of nine numbers, for any layout and for comparison.

It starts from a guess of each view alone and is refined jointly; the optimum is that of `cv2.stereoCalibrate`.
Pixels are upright full-frame coordinates, so the principal point of a right half counts from the frame's left edge.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration import one_lens
from prismstereo_calibration.bundle import LensModel
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.first_guess import guess_lens, spread
from prismstereo_calibration.projection import LENS_NUMBERS
from prismstereo_hw.lens import Lens
from prismstereo_hw.view import View

__all__ = ["model", "seeds"]

Array = NDArray[np.float64]
_FEWEST_FRAMES = 3
_SEED_FRAMES = 20


def model() -> LensModel:
    """Return how the lenses follow from 18 numbers: nine of the left view, nine of the right."""
    one, none = np.eye(LENS_NUMBERS), np.zeros((LENS_NUMBERS, LENS_NUMBERS))
    constant = np.zeros(LENS_NUMBERS)
    return LensModel("two-camera", np.hstack([one, none]), constant, np.hstack([none, one]), constant, _FEWEST_FRAMES)


def seeds(
    points: Array, pixels: Array, views: tuple[View, View], frame_width: int, frame_height: int
) -> tuple[Array, ...]:
    """Return 18 numbers each to start from; `pixels` are (V, 2, N, 2) upright.

    Each view alone, with all its numbers and with few; and both as pictures of one lens, which they are behind a prism:
    there the principal point stands at the very border of a view, and a view alone may not find it.
    """
    size = (frame_width, frame_height)
    found: list[Array] = []
    failure: CalibrationError | None = None
    for plain in (False, True):
        try:
            left, right = (_alone(points, pixels[:, side], view, size, plain=plain) for side, view in enumerate(views))
        except CalibrationError as error:
            failure = error
        else:
            found.append(model().own(left, right))
    if not any(view.turn_deg for view in views):
        with contextlib.suppress(CalibrationError):
            shared = one_lens.seed(points, pixels, views, frame_width, frame_height)
            found.append(model().own(*one_lens.model(views, frame_width, frame_height).lenses(shared)))
    if not found and failure is not None:
        raise failure
    return tuple(found)


def _alone(points: Array, pixels: Array, view: View, frame: tuple[int, int], *, plain: bool) -> Lens:
    """Guess a view's lens on its cut-out picture, whose middle is the guess of the principal point."""
    chosen = pixels[spread(len(pixels), _SEED_FRAMES)]
    corner = np.array(view.rectangle(*frame)[:2], np.float64)
    size = view.upright_size(*frame)
    lens = guess_lens([points] * len(chosen), list(chosen - corner), size, "the views", plain=plain)
    return replace(lens, cx_px=lens.cx_px + float(corner[0]), cy_px=lens.cy_px + float(corner[1]))
