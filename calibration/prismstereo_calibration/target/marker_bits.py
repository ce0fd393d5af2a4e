"""The bits of a marker, as they are printed.

An AprilTag stands as its inventors and Kalibr print it. OpenCV 4 has the four AprilTag families upside down, later releases
do not, and a printed sheet must not depend on who printed it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import UsageError

__all__ = ["Dictionary", "april_turned", "dictionary", "marker_bits"]

Dictionary = cv2.aruco.Dictionary

_APRIL = ("16h5", "25h9", "36h10", "36h11")
_TAG_36H11_0 = 0xD5D628584  # the first tag of the family 36h11, row after row, 1 is white


def dictionary(name: str) -> Dictionary:
    """Return OpenCV's dictionary of a name such as `4x4_100` or `36h11`; `UsageError` where there is none."""
    constant = f"DICT_APRILTAG_{name}" if name in _APRIL else f"DICT_{name.upper()}"
    number = getattr(cv2.aruco, constant, None)
    if number is None:
        raise UsageError(f"there is no marker dictionary {name!r}: give one like 4x4_100, 5x5_1000 or 36h11")
    return cv2.aruco.getPredefinedDictionary(int(number))


def marker_bits(book: Dictionary, number: int) -> NDArray[np.bool_]:
    """Return the inner modules (side, side) of a marker as OpenCV draws it, True where it is black."""
    drawn = np.squeeze(cv2.aruco.generateImageMarker(book, number, int(book.markerSize) + 2, borderBits=1))
    return np.asarray(drawn[1:-1, 1:-1] == 0)


def april_turned() -> bool:
    """Tell whether this OpenCV's AprilTags stand upside down, measured by the first tag of 36h11."""
    true = np.array([digit == "0" for digit in f"{_TAG_36H11_0:036b}"]).reshape(6, 6)
    return not np.array_equal(marker_bits(dictionary("36h11"), 0), true)
