"""Compile the filters' kernels before the first map comes, without keeping anybody waiting."""

from __future__ import annotations

import logging
import threading
import time

import numpy as np

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.disparity import DisparityMap
from prismstereo_device.filters.chain import FilterChain
from prismstereo_device.filters.clean import Clean
from prismstereo_device.filters.decimate import Decimate
from prismstereo_device.filters.holes import Holes
from prismstereo_device.filters.range_gate import RangeGate
from prismstereo_device.filters.spatial import Spatial
from prismstereo_device.filters.speckle import Speckle
from prismstereo_device.filters.temporal import Temporal

__all__ = ["warm_up"]

logger = logging.getLogger(__name__)

_SIDE_PX = 8


def warm_up(filters: FilterChain | None = None) -> threading.Thread:
    """Begin to compile the kernels of a chain (None: of all filters) in the background, and return the thread.

    A map that comes before the thread is done waits for the compiler as it would have without. What is compiled is kept on disk
    where there is a place for it, so that this takes seconds only once.
    """
    kinds = _ALL if filters is None else filters
    thread = threading.Thread(target=_compile, args=(kinds,), name="filters' warm-up", daemon=True)
    logger.info("compiling the disparity filters in the background (seconds once, then from the cache)")
    thread.start()
    return thread


_ALL = FilterChain((Speckle(), Clean(), Spatial(), Temporal(), Decimate(), Holes()))


def _compile(filters: FilterChain) -> None:
    began = time.monotonic()
    nothing = np.full((_SIDE_PX, _SIDE_PX), np.nan, np.float32)
    stream = FilterChain(tuple(each for each in filters.filters if not isinstance(each, RangeGate))).stream()
    for _ in range(2):  # the second map is the first that has one before it
        stream.apply(DisparityMap(nothing, DisparityWindow(16)))
    logger.debug("filters ready after %.1f s", time.monotonic() - began)
