"""Sub-pixel disparity by gradient least squares: shift the right picture until it lies on the left one.

Semi-global costs are nearly flat within half a pixel and their parabolas lean to whole pixels (pixel locking). Here each
window looks for the one disparity d that best explains its pixels, which were shifted by d_j each,
    g_j (d - d_j) = r_j,   r = right(x - d_j) - left,  g = slope of the left picture along the row,
the mean of each row of the window taken off: the method of Lucas and Kanade along epipolar rows. One disparity for all of them
also levels the steps and the speckle that the start brought along. The symmetric mean levels what noise is left.

Maps are int16 sixteenths of a pixel inside matchers, negative where unmatched: zero is a match like any other.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from threading import Thread

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.disparity import FRACTION

__all__ = ["refine", "refine_steps", "symmetric_mean", "warm_up"]

logger = logging.getLogger(__name__)

_UNMATCHED = -FRACTION  # OpenCV's mark
_ROUNDS = 2  # by when what a start leaned to whole pixels is gone
_LEAST_BAND = 16  # rows; a thread for fewer costs more than it saves

Grey = NDArray[np.uint8]
Steps = NDArray[np.int16]
Float = NDArray[np.float32]


def refine_steps(left: Grey, right: Grey, steps: Steps, threads: int = 2) -> Steps:
    """Return disparities (height, width) int16 sixteenths of a pixel, moved by at most half a pixel to where the views agree.

    `left` and `right` are grey pictures (height, width) uint8; negative `steps` are unmatched and stay as they are, the others
    never fall below zero. Once is enough for a start with fractions of its own; whole pixels gain a little from a second
    call. Any number of threads gives the same bits.
    """
    from prismstereo_device.match.subpixel_kernels import LEAST_WIDTH, refine_rows

    if steps.shape[1] < LEAST_WIDTH:
        return steps.copy()
    own, other = np.ascontiguousarray(left).reshape(-1), np.ascontiguousarray(right).reshape(-1)
    flat, refined = np.ascontiguousarray(steps).reshape(-1), np.empty(steps.size, np.int16)
    height, width = steps.shape

    def work(top: int, bottom: int) -> None:
        refine_rows(own, other, flat, refined, (height, width), top, bottom)

    _in_bands(work, height, threads)
    return refined.reshape(height, width)


def symmetric_mean(steps: Steps, threads: int = 2) -> Steps:
    """Return disparities (height, width) int16 sixteenths of a pixel, negative where unmatched, levelled over 5x5 pixels.

    Only what is within a pixel of the middle counts, in pairs that lie opposite each other: edges stay sharp, and slanted
    surfaces keep their slope. Any number of threads gives the same bits.
    """
    from prismstereo_device.match.subpixel_kernels import level_rows

    flat, levelled = np.ascontiguousarray(steps).reshape(-1), np.empty(steps.size, np.int16)
    height, width = steps.shape

    def work(top: int, bottom: int) -> None:
        level_rows(flat, levelled, (height, width), top, bottom)

    _in_bands(work, height, threads)
    return levelled.reshape(height, width)


def refine(left: Grey, right: Grey, disparity_px: Float, threads: int = 2) -> Float:
    """Return the disparity (height, width) float32 pixels in sixteenths, refined twice and levelled; NaN stays NaN.

    `left` and `right` are grey pictures (height, width) uint8.
    """
    known = ~np.isnan(disparity_px)
    steps = np.rint(np.where(known, disparity_px * np.float32(FRACTION), np.float32(_UNMATCHED))).astype(np.int16)
    for _ in range(_ROUNDS):
        steps = refine_steps(left, right, steps, threads)
    found = symmetric_mean(steps, threads)
    return np.where(known, found.astype(np.float32) / np.float32(FRACTION), np.float32(np.nan))


def warm_up() -> Thread:
    """Compile what this module runs, or read it from the cache, in the background; the thread is done when it is ready."""

    def run() -> None:
        picture = np.zeros((_LEAST_BAND, _LEAST_BAND), np.uint8)
        symmetric_mean(refine_steps(picture, picture, picture.astype(np.int16), threads=1), threads=1)

    logger.info("sub-pixel kernels: making them ready in the background, some seconds at the first start")
    thread = Thread(target=run, name="sub-pixel warm-up", daemon=True)
    thread.start()
    return thread


def _in_bands(work: Callable[[int, int], None], height: int, threads: int) -> None:
    """Do the work on rows top to bottom, in as many bands of rows as there are threads."""
    bands = max(1, min(threads, height // _LEAST_BAND))
    edges = [height * band // bands for band in range(bands + 1)]
    first, *others = pairwise(edges)
    if not others:
        work(*first)
        return
    with ThreadPoolExecutor(bands - 1) as pool:
        running = [pool.submit(work, top, bottom) for top, bottom in others]
        work(*first)
        for other in running:
            other.result()
