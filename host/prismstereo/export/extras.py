"""Packages that only some formats need: had, or asked for by the name of the extra that brings them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from prismstereo_hw.errors import UsageError

__all__ = ["extra_module"]


def extra_module(name: str, extra: str) -> Any:
    """Import a module of an optional package; UsageError names the extra where it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        raise UsageError(
            f"this format needs the package {name.partition('.')[0]!r} ({error}): install it with "
            f"`pip install 'prismstereo[{extra}]'`"
        ) from error
