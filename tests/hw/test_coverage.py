"""Which view a pixel belongs to: traced on a coarse grid, and still the same as traced pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest

from prismstereo_hw.coverage import SIDES, coverage, hidden_last, own_rows
from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import BUILT_IN, LITERATURE, Mode, Rig


@pytest.mark.parametrize("name", BUILT_IN + LITERATURE)
def test_the_coarse_grid_misses_nothing(name: str) -> None:
    rig = Rig.read(name)
    mode = Mode(width=502, height=283)  # no multiple of the grid's step
    found = coverage(rig, mode)
    pixels = np.stack(np.meshgrid(np.arange(502.0), np.arange(283.0)), axis=-1)
    slopes = rig.lens(mode).slopes(pixels)
    lit = [view_fates(rig, side, slopes).fate == 0 for side in SIDES]
    for exposure, seen_by in enumerate(found):
        exact = np.full((283, 502), -1, np.int8)
        for number in hidden_last(rig):
            mine = lit[number] & own_rows(rig, number, exposure, np.arange(283))[:, None]
            exact[mine & (exact < 0)] = number
        np.testing.assert_array_equal(seen_by, exact)
    assert not found.flags.writeable
