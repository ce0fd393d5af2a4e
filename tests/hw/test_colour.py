"""Dispersion: a prism that unfolds to a plate shifts colours by a tenth of a pixel, a biprism by several pixels."""

from __future__ import annotations

import numpy as np
import pytest

from prismstereo_hw.optics.colour import BLUE_F_NM, RED_C_NM, chromatic_shift_px, in_colour
from prismstereo_hw.optics.figures import figures
from prismstereo_hw.optics.sight import lit_slopes, sight
from prismstereo_hw.rig import Rig


def test_a_prism_rig_parts_the_colours_by_an_eighth_of_a_pixel_at_its_outer_edge(dslr: Rig) -> None:
    # optics reference, section 2: ~0.12 px at the outer edge at 0.4 m
    assert chromatic_shift_px(dslr, 400.0) == pytest.approx(0.12, abs=0.015)


def test_colours_of_a_prism_rig_come_together_with_distance(dslr: Rig) -> None:
    assert chromatic_shift_px(dslr, 4000.0) == pytest.approx(chromatic_shift_px(dslr, 400.0) / 10, rel=0.05)


def test_a_biprism_parts_the_colours_by_pixels_at_any_distance() -> None:
    biprism = Rig.read("biprism")

    # section 5 says 3.5 px at f 2030, without saying for which column; over the whole row it is 3.4 to 4.0
    assert chromatic_shift_px(biprism, 1e6) == pytest.approx(3.7, abs=0.4)


@pytest.mark.parametrize(("wavelength_nm", "baseline_mm"), [(RED_C_NM, 35.12), (BLUE_F_NM, 35.66)])
def test_blue_light_sees_a_biprism_with_a_larger_baseline(wavelength_nm: float, baseline_mm: float) -> None:
    rig = in_colour(Rig.read("biprism"), wavelength_nm)

    left, right = (sight(rig, side).centre_mm for side in ("left", "right"))

    assert right[0] - left[0] == pytest.approx(baseline_mm, abs=0.1)


@pytest.mark.parametrize("name", ["two-mirrors", "wedge", "four-mirrors"])
def test_mirrors_know_no_colour(name: str) -> None:
    assert figures(Rig.read(name)).chromatic_shift_px == 0.0


def test_directions_of_a_prism_rig_have_no_colour(dslr: Rig) -> None:
    slopes = lit_slopes(dslr, "left", middle_row=True)

    red, blue = (sight(in_colour(dslr, nm), "left").rays(slopes)[1] for nm in (RED_C_NM, BLUE_F_NM))

    np.testing.assert_allclose(red, blue, atol=1e-12)
