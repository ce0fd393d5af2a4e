"""A first guess of a lens from views of a board alone, by OpenCV's closed form and its refinement."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.lens import Lens

__all__ = ["FEWEST_TO_GUESS", "guess_lens", "spread"]

Array = NDArray[np.float64]

FEWEST_TO_GUESS = 6  # corners of one view: four make a homography, two more check it
_PLAIN = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3


def spread(count: int, most: int) -> NDArray[np.intp]:
    """Return at most so many indices, evenly over `count` frames: the guess slows down with the square of their number."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(np.intp))


def guess_lens(
    boards: list[Array], images: list[Array], size: tuple[int, int], what: str, *, plain: bool = True
) -> Lens:
    """Guess a lens from its pictures: one focal length, the principal point and k1, or all nine numbers if not `plain`.

    Boards are points (N, 3) with z = 0, images their pixels (N, 2) in pictures of that size (width, height); the middle
    of the picture is where the search for the principal point begins. `CalibrationError` names `what` was looked at where
    the pictures do not tell.
    """
    if not boards:
        raise CalibrationError(f"{what} show too little of the board to begin with: take some that show all of it")
    objects = [board.astype(np.float32) for board in boards]
    pixels = [image.astype(np.float32) for image in images]
    try:
        _, K, d, _, _ = cv2.calibrateCamera(objects, pixels, size, None, None, flags=_PLAIN if plain else 0)
    except cv2.error as error:
        raise CalibrationError(
            f"{what} do not tell the focal length: tilt the board 20 to 40 degrees in different directions, near and far"
        ) from error
    numbers = float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])
    k1, k2, p1, p2, k3 = (float(number) for number in np.ravel(d)[:5])
    return Lens(*numbers, (k1, k2, p1, p2, k3))
