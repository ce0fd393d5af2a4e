"""Compiling of kernels that also works where nothing can be written.

numba keeps what it compiled beside the source, in NUMBA_CACHE_DIR, or in the home folder. On a camera none of them may be
writable; then the kernels are compiled anew in every process, which costs seconds and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from numba import njit

__all__ = ["compiled"]

P = ParamSpec("P")
R = TypeVar("R")


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel at its first call, free of the interpreter lock, and keep it on disk where there is a place for it.

    Without `fastmath`: NaN means unmatched here, and sums are to have the same bits everywhere.
    """
    try:
        kept: Callable[P, R] = njit(nogil=True, error_model="numpy", cache=True)(kernel)
    except RuntimeError:  # numba found no folder that it can write to
        fresh: Callable[P, R] = njit(nogil=True, error_model="numpy")(kernel)
        return fresh
    return kept
