"""A ray that came through everything may still run into a part of the rig; then that is its fate, by name."""

from __future__ import annotations

import msgspec
import numpy as np

from prismstereo_hw.optics.trace import view_fates
from prismstereo_hw.rig import Rig


def middle_row(rig: Rig) -> np.ndarray:
    x, _, w, _ = rig.views[0].rectangle(1280, 720)
    columns = np.arange(x, x + w, dtype=float)
    return rig.lens().slopes(np.stack([columns, np.full_like(columns, rig.lens().cy_px)], axis=-1))


def test_nothing_stands_in_the_way_of_the_default_rigs(rig: Rig) -> None:
    traced = view_fates(rig, "left", middle_row(rig))

    blocked = [traced.fates.index(name) for name in traced.fates if name.startswith(("re-enters", "strikes"))]
    assert not np.isin(traced.fate, blocked).any()


def test_mirrors_that_lean_in_and_are_long_strike_each_other(dslr: Rig) -> None:
    leaning = msgspec.structs.replace(dslr.mirrors, angle_deg=74.0, near_edge_mm=20.0, offset_mm=20.0, length_mm=200.0)
    rig = msgspec.structs.replace(dslr, mirrors=leaning)

    traced = view_fates(rig, "left", middle_row(rig))

    assert (traced.fate == traced.fates.index("strikes the other mirror")).mean() > 0.05


def test_outer_mirrors_that_lean_in_send_the_view_into_the_inner_faces() -> None:
    rig = msgspec.structs.replace(Rig.read("four-mirrors"), outer_angle_deg=70.0, near_edge_mm=15.0)

    traced = view_fates(rig, "left", middle_row(rig))

    assert (traced.fate == traced.fates.index("runs into the inner faces")).mean() > 0.3
