"""The code's markers in a picture.

OpenCV finds the dark quadrangles, and their modules are compared here with all markers of both dictionaries at once: a board
has many markers of its own, and OpenCV takes a second to tell each of them from a thousand others.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.target.code import CODE_DICTIONARIES
from prismstereo_calibration.target.marker_bits import Dictionary, dictionary

__all__ = ["seen_markers"]

_SMALLEST_PICTURE = 16
_ENLARGED_BELOW = (
    1600  # pixels along the longer side: smaller pictures are read at twice their size, small modules too then
)
_LEAST_PERIMETER = 28.0  # pixels around a marker of 7 modules of one pixel
_CELL = 8  # pixels of a module where its colour is judged
_RIM = 2  # of them that may belong to a neighbour
_LEAST_SPREAD = 5.0  # grey levels, standard deviation: less is a dark patch and noise
_BORDER_ERRORS = 2  # modules of the border that may be bright
_WRONG_BITS = {
    "5x5_1000": 1,
    "6x6_1000": 2,
}  # that may be wrong within; the code's checksum guards what then is mistaken

Picture = NDArray[np.uint8]


def seen_markers(picture: Picture) -> dict[str, set[int]]:
    """Return the numbers of the markers of each code dictionary in an upright picture, (height, width[, 3]) uint8."""
    if min(picture.shape[:2]) < _SMALLEST_PICTURE:
        return {name: set() for name in CODE_DICTIONARIES}
    grey = picture if picture.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_BGR2GRAY)
    fine = np.ascontiguousarray(grey, np.uint8)
    if max(grey.shape) < _ENLARGED_BELOW:
        fine = cv2.resize(fine, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC).astype(np.uint8)
    quadrangles = _quadrangles(fine, _LEAST_PERIMETER / max(grey.shape))
    return {name: _named(fine, quadrangles, name) for name in CODE_DICTIONARIES}


def _quadrangles(grey: Picture, least_perimeter: float) -> list[NDArray[np.float32]]:
    """Return the corners (4, 2) of what may be markers: all that a detector looks at which knows one marker only."""
    book = dictionary(CODE_DICTIONARIES[0])
    one = cv2.aruco.Dictionary(book.bytesList[:1].copy(), book.markerSize, 0)
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = min(least_perimeter, 1.0)
    known, _, unknown = cv2.aruco.ArucoDetector(one, settings).detectMarkers(grey)
    return [np.reshape(corners, (4, 2)).astype(np.float32) for corners in (*known, *unknown)]


def _named(grey: Picture, quadrangles: list[NDArray[np.float32]], name: str) -> set[int]:
    book = dictionary(name)
    inner = [bits for bits in (_bits(grey, corners, book) for corners in quadrangles) if bits is not None]
    if not inner:
        return set()
    seen, known = _signs(_packed(np.array(inner))), _signs(_turned(book))
    wrong = (seen.shape[1] - seen @ known.T) / 2
    nearest = wrong.argmin(axis=1)
    right = wrong[np.arange(len(nearest)), nearest] <= _WRONG_BITS[name]
    return set((nearest[right] // 4).tolist())


def _bits(grey: Picture, corners: NDArray[np.float32], book: Dictionary) -> NDArray[np.bool_] | None:
    """Return the modules (bits, bits) within a quadrangle's dark border, True where bright; None without such a border."""
    modules = int(book.markerSize) + 2
    side = modules * _CELL
    square = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) - 0.5
    onto = cv2.getPerspectiveTransform(square, corners)
    straight = cv2.warpPerspective(grey, onto, (side, side), flags=cv2.WARP_INVERSE_MAP | cv2.INTER_LINEAR)
    if straight.std() < _LEAST_SPREAD:
        return None
    level, _ = cv2.threshold(straight, 0, 255, cv2.THRESH_OTSU)
    cells = straight.reshape(modules, _CELL, modules, _CELL)[:, _RIM:-_RIM, :, _RIM:-_RIM].mean(axis=(1, 3))
    bright = cells > level
    inside = np.asarray(bright[1:-1, 1:-1])
    return inside if bright.sum() - inside.sum() <= _BORDER_ERRORS else None


def _packed(bits: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Pack modules (K, bits, bits) as OpenCV does: whole bytes, then what is left at the low end of one more."""
    flat = bits.reshape(len(bits), -1)
    whole = flat.shape[1] // 8 * 8
    rest = np.pad(flat[:, whole:], ((0, 0), (8 - flat.shape[1] % 8, 0)))
    return np.packbits(np.concatenate([flat[:, :whole], rest], axis=1), axis=1)


def _turned(book: Dictionary) -> NDArray[np.uint8]:
    """Return the bytes (4 N, bytes) of every marker in its four attitudes, which OpenCV keeps one after the other."""
    return np.ascontiguousarray(book.bytesList, np.uint8).reshape(4 * len(book.bytesList), -1)


def _signs(packed: NDArray[np.uint8]) -> NDArray[np.float32]:
    return 2 * np.unpackbits(packed, axis=1).astype(np.float32) - 1
