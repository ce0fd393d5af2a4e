"""Codec 2 on real maps: bits per pixel of the whole map, tables included, and frozen tables on what they were not fitted on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from device.disparity_corpus import FITTED, HELD_OUT, PAIRS, matched_pair
from prismstereo_device.codec.compact import BOUNDS, Tables, encode_stripes


@pytest.mark.soak
@pytest.mark.parametrize(("bound", "most_bpp"), [(0, 1.55), (2, 0.70), (4, 0.52)])
def test_real_maps_take_few_bits(data: Path, bound: int, most_bpp: float) -> None:
    maps = {name: matched_pair(data, name) for name in PAIRS}
    bits = {name: 8 * encode_stripes(steps, bound).size / steps.size for name, steps in maps.items()}
    table = ", ".join(f"{name} {value:.2f}" for name, value in bits.items())
    print(f"codec 2 within {bound}/16 px, bits per pixel: {table}; mean {np.mean(list(bits.values())):.3f}")
    assert np.mean(list(bits.values())) <= most_bpp


MOST_COST = {"depth camera": 0.45, "depth camera, other frames": 0.45, "truth": 1.30}  # no matcher made these


@pytest.mark.soak
@pytest.mark.parametrize("name", [*FITTED, *HELD_OUT])
def test_frozen_tables_cost_little_on_maps_that_they_were_not_fitted_on(data: Path, name: str) -> None:
    maps = (FITTED | HELD_OUT)[name](data)
    costs = []
    for bound in BOUNDS:
        own = sum(encode_stripes(steps, bound).size for steps in maps)
        frozen = sum(encode_stripes(steps, bound, Tables.frozen(bound)).size for steps in maps)
        costs.append(frozen / own - 1)
    print(f"frozen tables, {name}: " + ", ".join(f"n={n} {cost:+.1%}" for n, cost in zip(BOUNDS, costs, strict=True)))
    assert max(costs) < MOST_COST.get(name, 0.10)
