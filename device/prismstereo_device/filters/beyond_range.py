"""Which unmatched pixels lie nearer or farther than the search range, told by looking there in small pictures.

Every disparity of the range is tried, and as many nearer ones again, on pictures of a quarter of the width and an
eighth of the height: what is too near is large. Where the range has a far end, a quarter as many are tried beyond it.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.reasons import Reason

__all__ = ["BLOCK", "beyond_range"]

Grey = NDArray[np.uint8]
Picture = NDArray[np.integer[Any] | np.floating[Any]]  # as OpenCV's stubs have it
Cost = NDArray[np.uint16]

BLOCK = 4, 8  # columns and rows that one small pixel stands for
_LOCAL_PX, _BLOCK_PX = (9, 5), (5, 3)  # columns and rows of the small pictures
_CAP = 31  # grey levels from the local mean
_CLEARLY = 0.6  # a cost beyond that is this part of the best within
_LIKE_ITSELF = 0.5  # and this part of the contrast that there is to explain
_NONE = np.uint16(65535)


def beyond_range(left: Grey, right: Grey, window: DisparityWindow) -> Grey:
    """Return `TOO_NEAR`, `TOO_FAR` or 0 for each block of `BLOCK` = (columns, rows) pixels of the left picture.

    Without a row or column where a picture (height, width) is too small to look at.
    """
    height, width = left.shape
    size = width // BLOCK[0], height // BLOCK[1]
    if size[0] < _LOCAL_PX[0] or size[1] < _LOCAL_PX[1]:
        return np.zeros((0, 0), np.uint8)
    own, other = _contrast(left, size), _contrast(right, size)
    labels = math.ceil(window.labels / BLOCK[0])
    within = _best(own, other, range(labels))
    near = _best(own, other, range(labels, 2 * labels))
    finite = window.scale_px > 0 and math.isfinite(window.farthest)
    far = _best(own, other, range(-max(labels // 4, 1), 0) if finite else range(0))
    bound = np.minimum(_CLEARLY * within, _LIKE_ITSELF * _sum(cv2.absdiff(own, np.full_like(own, _CAP))))
    found = np.where(near < bound, np.uint8(Reason.TOO_NEAR), np.uint8(0))
    found[(far < bound) & (far < near)] = Reason.TOO_FAR
    return found


def _contrast(picture: Grey, size: tuple[int, int]) -> Grey:
    """Return the picture of blocks as differences from its local mean, capped and lifted by the cap: gain drops out."""
    whole = picture[: size[1] * BLOCK[1], : size[0] * BLOCK[0]]
    small = cv2.resize(whole, size, interpolation=cv2.INTER_AREA).astype(np.int16)
    local = cv2.blur(small, _LOCAL_PX)
    return np.asarray(np.clip(small - local, -_CAP, _CAP) + _CAP, np.uint8)


def _best(own: Grey, other: Grey, disparities: range) -> Cost:
    """Return the least cost over some disparities for each small pixel, `_NONE` where no partner is in the picture."""
    width = own.shape[1]
    best = np.full(own.shape, _NONE, np.uint16)
    for d in disparities:
        if not -width < d < width:
            continue
        columns = slice(max(d, 0), width + min(d, 0))
        partners = slice(max(-d, 0), width - max(d, 0))
        cost = _sum(cv2.absdiff(own[:, columns], other[:, partners]))
        best[:, columns] = np.minimum(best[:, columns], cost)
    return best


def _sum(differences: Picture) -> Cost:
    summed = cv2.boxFilter(differences, cv2.CV_16U, _BLOCK_PX, normalize=False)
    return np.asarray(summed, np.uint16)
