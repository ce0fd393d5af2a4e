"""Compile a loop over bare arrays: no global lock, cached on disk where any folder can be written, in memory where none can.

numba looks for a folder to write to when a function is decorated (NUMBA_CACHE_DIR, then __pycache__, then the user's cache) and
raises when it finds none, as on a camera whose file system is read-only. There the loop is compiled once per start.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ["compiled", "compiled_any", "compiled_for", "inlined"]

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a function at its first call; a division by zero gives inf or NaN, as in numpy."""
    try:
        return cast("F", njit(nogil=True, cache=True, error_model="numpy")(function))
    except RuntimeError:  # no folder to keep the machine code in
        return cast("F", njit(nogil=True, error_model="numpy")(function))


def compiled_any(function: Callable[..., Any]) -> Any:
    """Compile like `compiled`; of calls of the result only numba checks the types: for loops over a dozen arrays."""
    return compiled(function)


def compiled_for(signature: object) -> Callable[[F], F]:
    """Compile a function at once, for arguments of these types: nobody waits for the compiler later."""

    def decorate(function: F) -> F:
        try:
            return cast("F", njit(signature, nogil=True, cache=True)(function))
        except RuntimeError:  # no folder to keep the machine code in
            return cast("F", njit(signature, nogil=True)(function))

    return decorate


def inlined(function: F) -> F:
    """Compile a function into the loops that call it: numbers it is given there become constants."""
    return cast("F", njit(error_model="numpy", forceinline=True)(function))
