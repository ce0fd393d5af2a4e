"""Glasses: the catalogue's indices, and what is no glass."""

from __future__ import annotations

import pytest

from prismstereo_hw.errors import RigError
from prismstereo_hw.glass import GLASSES, HELIUM_D_NM, refractive_index

HYDROGEN_F_NM, HYDROGEN_C_NM = 486.1327, 656.2725


@pytest.mark.parametrize(
    ("glass", "n_F", "n_d", "n_C"),
    [  # the makers' printed indices
        ("N-BK7", 1.52238, 1.51680, 1.51432),
        ("fused silica", 1.46313, 1.45846, 1.45637),
        ("N-SF11", 1.80651, 1.78472, 1.77596),
    ],
)
def test_the_catalogue_indices_come_out_to_five_digits(glass: str, n_F: float, n_d: float, n_C: float) -> None:
    assert refractive_index(glass, HYDROGEN_F_NM) == pytest.approx(n_F, abs=1.5e-5)
    assert refractive_index(glass, HELIUM_D_NM) == pytest.approx(n_d, abs=1.5e-5)
    assert refractive_index(glass, HYDROGEN_C_NM) == pytest.approx(n_C, abs=1.5e-5)


def test_every_named_glass_bends_light() -> None:
    assert all(1.4 < refractive_index(glass) < 1.9 for glass in GLASSES)


def test_an_index_may_be_given_as_a_number() -> None:
    assert refractive_index("1.62") == 1.62


@pytest.mark.parametrize("glass", ["BK7", "", "n-bk7", "1,5168"])
def test_an_unknown_glass_is_refused_with_the_names_there_are(glass: str) -> None:
    with pytest.raises(RigError, match=rf"no glass {glass!r}: choose one of N-BK7, .*PC, or give its index"):
        refractive_index(glass)


@pytest.mark.parametrize("glass", ["1", "0", "-1.5", "3", "nan", "inf", "1e400"])
def test_an_impossible_index_is_refused(glass: str) -> None:
    with pytest.raises(RigError, match=rf"glass index {glass} is not between 1 and 3: give one like 1\.52"):
        refractive_index(glass)
