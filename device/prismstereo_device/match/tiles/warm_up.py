"""Compile the kernels before the first frame needs them."""

from __future__ import annotations

import logging
import time
from threading import Thread

import numpy as np

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.rectify import RectifiedPair

__all__ = ["warm_up"]

logger = logging.getLogger(__name__)
_ROWS, _COLUMNS = 64, 96


def warm_up(labels: int = 128) -> Thread:
    """Begin to compile for a search over so many labels, in the background; `join` the thread to wait for it.

    Takes some seconds once and a fraction of one later, where machine code can be kept on disk. A frame that comes earlier
    waits for it.
    """
    thread = Thread(target=_compile, args=(labels,), name="compile matcher", daemon=True)
    logger.info("the matcher is being compiled for this processor: seconds the first time, then kept on disk")
    thread.start()
    return thread


def _compile(labels: int) -> None:
    from prismstereo_device.match.subpixel import refine_steps
    from prismstereo_device.match.tiles.tiles import TilesMatcher

    begin = time.perf_counter()
    picture = np.random.default_rng(0).integers(0, 256, (_ROWS, _COLUMNS), np.uint8)
    pair = RectifiedPair(picture, picture, DisparityWindow(labels))
    TilesMatcher(refine=refine_steps).match(pair)  # all that a frame meets: the sweeps, sub-pixels, masks
    logger.info("the matcher is ready after %.1f s", time.perf_counter() - begin)
