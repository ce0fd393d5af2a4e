"""The small learned part: two nets of a few thousand numbers that draw a cell's side map from its votes.

They were trained on scenes of the optical twin alone, see `prismstereo.fusion.training`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from prismstereo_hw.errors import DataError

__all__ = ["COARSE", "FINE", "NETS", "SideNet", "read_nets"]

COARSE, FINE = 4, 8  # places along the side of a cell: for fewer and for more still pixels a site
NETS = Path(__file__).with_name("side_nets.npz")
_LABELS = 16
_BY = 8


@dataclass(frozen=True, slots=True)
class SideNet:
    """A net for `side` places along a cell: `layers` (N,) int32 its widths, `numbers` float32 weights and biases in a row."""

    side: int
    layers: NDArray[np.int32]
    numbers: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Refuse a net that does not fit the votes of a cell."""
        area, widths = self.side**2, [int(width) for width in self.layers]
        if len(widths) == 0:
            return
        needed = sum((fan + 1) * width for fan, width in pairwise(widths))
        if widths[0] != 2 * area + _LABELS or widths[-1] != area or any(width % _BY for width in widths):
            raise DataError(
                f"a net of widths {widths} does not go from {2 * area + _LABELS} votes to {area} places in eights"
            )
        if self.numbers.size != needed or not np.isfinite(self.numbers).all():
            raise DataError(
                f"a net of widths {widths} has {needed} finite numbers, not {self.numbers.size}: copy it again"
            )

    @classmethod
    def none(cls, side: int) -> SideNet:
        """Return the net that is not there: the votes alone decide."""
        return cls(side, np.zeros(0, np.int32), np.zeros(0, np.float32))


@lru_cache(maxsize=2)
def read_nets(path: Path = NETS) -> dict[int, SideNet]:
    """Read the nets by their side; `DataError` for a file that holds none, or not these."""
    try:
        with np.load(path, allow_pickle=False) as held:
            return {
                side: SideNet(side, held[f"layers_{side}"].astype(np.int32), held[f"numbers_{side}"].astype(np.float32))
                for side in (COARSE, FINE)
            }
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{path} does not hold the upsampler's nets: {error}: install again") from error
