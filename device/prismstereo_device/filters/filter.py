"""What every filter is: a few checked numbers from a chain file, which make a stage.

A filter has a method `stage`: it makes the stage of one stream, and whatever that remembers of earlier maps belongs to
that stream alone.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from prismstereo_device.filters.sheet import Sheet

__all__ = ["Filter", "Stage"]

Stage = Callable[[Sheet], Sheet]


class Filter(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """The settings of one filter; its `kind` is its name in a chain file."""
