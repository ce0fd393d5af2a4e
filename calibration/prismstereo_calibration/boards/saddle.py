"""Saddles of grey: the points where two dark and two bright squares meet, to a few hundredths of a pixel.

Pixels. (0, 0) is the centre of the top-left pixel. A board's corner is unknown where it is NaN.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["centred", "grey_of", "jacobians", "refined", "sample"]

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
_LEAST_HALF_PX, _MOST_HALF_PX = 2, 15
_ROUNDS = 5  # of centring: each leaves about a tenth of what was off
_SMOOTHED_PX = 0.7  # against what interpolation makes of edges that are sharper than a pixel
_DAMPING = 1e-3  # square grey levels per square pixel: nothing, but a flat patch stays where it is
_SLOPES = (np.array([-1.0, 0.0, 1.0]), np.ones(1)), (np.ones(1), np.array([-1.0, 0.0, 1.0]))  # along x, along y
_STEP = 0.05  # squares: over which the scale of a homography is taken


def grey_of(image: Grey) -> Grey:
    """Return the grey values (height, width) of a picture (height, width[, 3]) uint8."""
    grey = image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(grey, np.uint8)


def refined(grey: Grey, start: Array, reach_px: Array) -> Array:
    """Move points (N, 2) to their saddles, each within a window that reaches so many pixels (N,) to every side."""
    halves = np.clip(np.rint(reach_px), _LEAST_HALF_PX, _MOST_HALF_PX).astype(int)
    moved = np.empty_like(start)
    for half in np.unique(halves):
        chosen = halves == half
        window = (int(half), int(half))
        points = start[chosen].astype(np.float32).reshape(-1, 1, 2)
        moved[chosen] = np.reshape(cv2.cornerSubPix(grey, points, window, (-1, -1), _STOP), (-1, 2))
    return moved


def sample(grey: Grey, pixels: Array) -> Array:
    """Return the grey values (...) at pixels (..., 2), NaN outside the picture."""
    height, width = grey.shape
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(axis=-1) & (pixels[..., 0] <= width - 1) & (pixels[..., 1] <= height - 1)
    rows = np.nan_to_num(pixels).reshape(-1, pixels.shape[-2], 2)
    x, y = (np.ascontiguousarray(rows[..., axis], np.float32) for axis in (0, 1))
    value = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(inside, np.reshape(value, inside.shape).astype(np.float64), np.nan)


def jacobians(H: Array, points: Array) -> Array:
    """Return how a homography (3, 3) stretches its plane at points (N, 2): (N, 2, 2), columns along its x and y."""
    ends = (points, points + np.array([_STEP, 0.0]), points + np.array([0.0, _STEP]))
    here, along_x, along_y = (cv2.perspectiveTransform(end.reshape(-1, 1, 2), H).reshape(-1, 2) for end in ends)
    return np.stack([along_x - here, along_y - here], axis=-1) / _STEP


def centred(grey: Grey, start: Array, offsets: Array, opposite: Array) -> Array:
    """Move points (N, 2) to where the grey is the same as its own half turn, as a saddle's is however blurred.

    Compared is the grey at `offsets` (N, K, 2) pixels from each point with that at their `opposite` ones. Least squares, which
    wastes no light: what a saddle's edges tell of its place under noise, it tells. A slope of the light does not count.
    """
    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTHED_PX), np.float32)
    across, along = (np.asarray(cv2.sepFilter2D(smooth, -1, *kernels) / 2, np.float32) for kernels in _SLOPES)
    moved = start.copy()
    for _ in range(_ROUNDS):
        here, there = moved[:, None] + offsets, moved[:, None] + opposite
        difference, dx, dy = (_values(one, here) - _values(one, there) for one in (smooth, across, along))
        A = np.stack([dx, dy, offsets[..., 0], offsets[..., 1]], axis=-1)
        normal = np.einsum("nki,nkj->nij", A, A) + _DAMPING * np.eye(4)
        step = np.linalg.solve(normal, np.einsum("nki,nk->ni", A, difference)[..., None])[:, :2, 0]
        moved = moved - np.clip(step, -1.0, 1.0)
    return moved


def _values(picture: NDArray[np.float32], pixels: Array) -> Array:
    """Return a picture's values (N, K) at pixels (N, K, 2), its border going on beyond it."""
    x, y = (np.ascontiguousarray(pixels[..., axis], np.float32) for axis in (0, 1))
    values = cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float64)
