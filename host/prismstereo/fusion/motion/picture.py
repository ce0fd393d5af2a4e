"""Pictures as the motion analysis takes them: float32 channels, grey, and a still as the video would have shown it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from prismstereo.fusion.upsampling.grid import Grid
from prismstereo_hw.errors import DataError

__all__ = ["HALF_STEP", "channels", "enlarged", "grey", "high_from_low", "reduced", "require_picture"]

Float = NDArray[np.float32]
Matrix = NDArray[np.float64]
Picture = NDArray[np.uint8]

HALF_STEP = 2  # features and fine alignment work on pictures with this many pixels for one of the video
_SMALLEST = 32


def require_picture(pixels: Picture, name: str) -> None:
    """Refuse what is no picture of at least 32 x 32 pixels, grey or BGR, 8 bits: raises DataError."""
    shape = pixels.shape
    right = len(shape) == 2 or (len(shape) == 3 and shape[2] == 3)
    if pixels.dtype != np.uint8 or not right or min(shape[:2]) < _SMALLEST:
        raise DataError(
            f"{name} is {pixels.dtype} {shape}: give a grey or BGR picture of 8 bits, {_SMALLEST} x {_SMALLEST} or more"
        )


def channels(pixels: Picture | Float) -> Float:
    """Return a picture (height, width[, c]) as (height, width, c) float32."""
    return np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[..., None], np.float32)


def grey(pixels: Picture | Float) -> Float:
    """Return the mean of a picture's channels, (height, width) float32."""
    if pixels.ndim == 2:
        return np.ascontiguousarray(pixels, np.float32)
    return np.asarray(
        cv2.transform(pixels.astype(np.float32), np.full((1, pixels.shape[2]), 1 / pixels.shape[2])), np.float32
    )


def high_from_low(grid: Grid) -> Matrix:
    """Return the matrix (3, 3) that takes a video pixel to its place in the still."""
    return np.array(
        [
            [grid.scale_x, 0, (grid.scale_x - 1) / 2 + grid.shift_x_px],
            [0, grid.scale_y, (grid.scale_y - 1) / 2 + grid.shift_y_px],
            [0, 0, 1.0],
        ]
    )


def enlarged(factor: float) -> Matrix:
    """Return the matrix (3, 3) from pixels to those of the same picture with `factor` times as many each way."""
    return np.array([[factor, 0, (factor - 1) / 2], [0, factor, (factor - 1) / 2], [0, 0, 1.0]])


def reduced(still: Picture, grid: Grid, shape: tuple[int, ...], factor: int = 1) -> Picture:
    """Return a still as a video of size `shape` (height, width) would show it, `factor` times as fine; the rim is continued."""
    height, width = shape[0] * factor, shape[1] * factor
    spread = [math.sqrt(max((scale / factor) ** 2 - 1, 0) / 12) for scale in (grid.scale_x, grid.scale_y)]
    smooth: NDArray[np.uint8] = still
    if max(spread) > 0.1:
        sigmas = [max(each, 0.1) for each in spread]
        smooth = np.asarray(cv2.GaussianBlur(still, (0, 0), sigmaX=sigmas[0], sigmaY=sigmas[1]), np.uint8)
    M = high_from_low(grid) @ np.linalg.inv(enlarged(factor))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(smooth, M[:2], (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )
