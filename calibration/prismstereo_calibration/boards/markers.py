"""Square markers in a picture: their numbers and roughly where their corners are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["DICTIONARIES", "Markers", "read_markers"]

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

_FLAT, _PALE = (
    8.0,
    128.0,
)  # grey levels from dark to bright: below the one there is nothing to stretch, above the other no need

DICTIONARIES = ("4x4_1000", "5x5_1000", "6x6_1000", "7x7_1000", "36h11", "36h10", "25h9", "16h5")
"""The largest dictionary of every family: the smaller ones of a family are its beginning."""


@dataclass(frozen=True, slots=True)
class Markers:
    """Numbers (M,) and corners (M, 4, 2) pixels, clockwise from the one that is upper left when a marker stands upright."""

    ids: NDArray[np.intp]
    corners: Array

    def those(self, chosen: NDArray[np.bool_]) -> Markers:
        """Return the chosen ones alone."""
        return Markers(self.ids[chosen], self.corners[chosen])

    @property
    def sides_px(self) -> Array:
        """Return the length (M,) of a side, mean over the four."""
        return np.asarray(np.linalg.norm(self.corners - np.roll(self.corners, 1, axis=1), axis=-1).mean(axis=1))


def read_markers(
    grey: Grey, dictionary: str, border: int = 1, numbers: int | None = None, *, inverted_too: bool = False
) -> Markers:
    """Read markers of a dictionary (`4x4_100`, `36h11`) with so many modules of black border in a grey picture.

    `numbers`: only those below; the fewer there may be, the faster they are told apart and the less clutter passes for one.
    `inverted_too`: white on black as well as black on white.
    """
    kind = f"DICT_APRILTAG_{dictionary}" if "h" in dictionary else f"DICT_{dictionary.upper()}"
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    parameters.detectInvertedMarker = inverted_too
    known = cv2.aruco.getPredefinedDictionary(int(getattr(cv2.aruco, kind)))
    if numbers is not None:
        known = cv2.aruco.Dictionary(known.bytesList[:numbers].copy(), known.markerSize, known.maxCorrectionBits)
    corners, ids, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(_evened(grey))
    if not len(corners):
        return Markers(np.zeros(0, np.intp), np.zeros((0, 4, 2)))
    return Markers(np.ravel(ids).astype(np.intp), np.reshape(np.stack(corners), (-1, 4, 2)).astype(np.float64))


def _evened(grey: Grey) -> Grey:
    """Stretch the grey of a dim or a pale picture: the detector's thresholds are for pictures with black and white in them."""
    low, high = np.percentile(grey[::4, ::4], [0.5, 99.5])
    if not _FLAT < high - low < _PALE:
        return grey
    return np.asarray(np.clip((grey - low) * (255 / (high - low)), 0, 255), np.uint8)
