"""What is wished of a sensor, held against what it can do."""

from __future__ import annotations

from prismstereo_device.sensors.base import Limit
from prismstereo_device.sensors.options import Options
from prismstereo_hw.errors import UsageError

__all__ = ["require_within", "wished_size"]


def require_within(name: str, value: float | None, limit: Limit | None) -> None:
    """Raise `UsageError` where a value is wished that cannot be set, or not so far; no wish is always granted."""
    if value is None:
        return
    if limit is None:
        raise UsageError(f"{name} {value:g}: this camera's {name} cannot be set, leave it as it is")
    if not limit.least <= value <= limit.most:
        raise UsageError(f"{name} {value:g}: this camera takes {limit.least:g} to {limit.most:g}")


def wished_size(options: Options) -> tuple[int, int] | None:
    """Return the (width, height) in pixels that the options `width` and `height` ask for; None without both of them."""
    width, height = options.whole("width", 16, 16384), options.whole("height", 16, 16384)
    if width is None and height is None:
        return None
    if width is None or height is None:
        raise UsageError("give width and height, or neither of them")
    return width, height
