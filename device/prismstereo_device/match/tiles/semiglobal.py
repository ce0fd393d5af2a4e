"""Semi-global matching with all labels everywhere: the choice where labels overflow, and what `tiles` is measured by."""

from __future__ import annotations

from prismstereo_device.match.tiles.lanes import TILE
from prismstereo_device.match.tiles.level import Level
from prismstereo_device.match.tiles.sweeping import SweepMatcher, dense_rows

__all__ = ["SemiglobalMatcher"]


class SemiglobalMatcher(SweepMatcher):
    """Semi-global matching along rows and columns, with all labels in every tile.

    Pictures whose volume would be larger than a gigabyte are matched in bands of rows that overlap by a tile.
    """

    def levels(self, height: int, width: int, count: int, workers: int) -> list[Level]:
        """Return the one level there is."""
        return [Level(height, width, count, None, workers)]

    def rows_at_once(self, height: int, width: int, count: int) -> int:
        """Return the rows that fit, less what bands overlap by."""
        rows = dense_rows(width, count)
        return height if rows >= height else max(rows - 2 * TILE, TILE)
