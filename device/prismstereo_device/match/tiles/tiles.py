"""Semi-global matching over short label lists: ten labels per tile instead of all of them, found by a coarse pass.

The coarse pass is the same matcher with all labels on a picture of half the width and a quarter of the height; where that
is still large, it has a coarser one of its own. A tile of 32x32 pixels then tries what the coarse map shows around it.
"""

from __future__ import annotations

from prismstereo_device.match.settings import MatchSettings
from prismstereo_device.match.tiles.level import Level, Penalties
from prismstereo_device.match.tiles.pyramid import Refine
from prismstereo_device.match.tiles.sweeping import SweepMatcher, dense_bytes

__all__ = ["TilesMatcher"]

_AS_USUAL = MatchSettings()
_PRICES = Penalties()
_COARSE_ROWS, _COARSE_COLUMNS = 4, 2  # pixels of a coarse one
_MOST_LABELS = 256  # of a tile's list; more lose the rarest
_LARGEST_COARSE = 1 << 27  # bytes of the coarse volume, above which it gets a coarser one itself
_SMALL_PX, _FEW_LABELS = 48, 8  # where a coarse pass would have nothing to see


class TilesMatcher(SweepMatcher):
    """Semi-global matching over a short list of labels per tile of 32x32 pixels.

    The map of the frame before, where there is one, adds labels and takes none away: what is new is found as if it were
    not there. `coarse_rows`: rows of the picture in one of the coarse pass, 2 (finer) or 4 (faster).
    """

    def __init__(
        self,
        settings: MatchSettings = _AS_USUAL,
        *,
        prices: Penalties = _PRICES,
        refine: Refine | None = None,
        coarse_rows: int = _COARSE_ROWS,
    ) -> None:
        super().__init__(settings, prices=prices, refine=refine)
        self._coarse_rows = coarse_rows

    def levels(self, height: int, width: int, count: int, workers: int) -> list[Level]:
        """Return the levels, coarsest first."""
        tiny = min(height, width) < _SMALL_PX or count < _FEW_LABELS
        if tiny and dense_bytes(height, width, count) <= _LARGEST_COARSE:
            return [Level(height, width, count, None, workers)]
        small = -(-height // self._coarse_rows), -(-width // _COARSE_COLUMNS), -(-count // _COARSE_COLUMNS)
        fine = Level(height, width, count, min(count, _MOST_LABELS), workers)
        if dense_bytes(*small) > _LARGEST_COARSE and min(small) >= _SMALL_PX:
            return [*self.levels(*small, workers), fine]
        return [Level(*small, None, workers), fine]
