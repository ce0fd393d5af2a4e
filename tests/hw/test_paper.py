"""The paper's section 3.2 against the reference's reconstruction, and against the exact optics where the two meet."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_hw import paper
from prismstereo_hw.errors import UsageError
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.paper import MirrorTerm, baseline_mm
from prismstereo_hw.rig import Rig

TABLE = {  # B at 49.3 exactly, and the beta that gives 49.62
    MirrorTerm.MINUS_SINE: (49.844, 49.3118),
    MirrorTerm.MINUS_COSINE: (49.815, 49.3100),
    MirrorTerm.PLUS_SINE: (49.436, 49.2933),
    MirrorTerm.PLUS_COSINE: (49.464, 49.2942),
    MirrorTerm.ABSENT: (49.640, 49.3009),
}
EVERY = pytest.mark.parametrize("term", MirrorTerm, ids=lambda term: term.name.lower())
FOUR = [term for term in MirrorTerm if term is not MirrorTerm.ABSENT]


def slope(change_per: str, value: float, step: float, term: MirrorTerm = MirrorTerm.MINUS_SINE) -> float:
    def at(v: float) -> float:
        return baseline_mm(paper.MIRROR_TILT_DEG, term, **{change_per: v})

    return (at(value + step) - at(value - step)) / (2 * step)


@EVERY
def test_each_variant_gives_the_reference_baseline_to_the_last_digit(term: MirrorTerm) -> None:
    assert baseline_mm(paper.MIRROR_TILT_DEG, term) == pytest.approx(TABLE[term][0], abs=0.0005)


@EVERY
def test_the_published_baseline_belongs_to_a_tilt_that_rounds_to_the_published_one(term: MirrorTerm) -> None:
    tilt = TABLE[term][1]
    # the tilt is known to a ten-thousandth of a degree, and B falls by 19 mm for each degree
    assert baseline_mm(tilt, term) == pytest.approx(paper.PUBLISHED_BASELINE_MM, abs=20 * 0.0001)
    assert round(tilt, 1) == paper.MIRROR_TILT_DEG


@pytest.mark.parametrize("term", FOUR, ids=lambda term: term.name.lower())
def test_no_variant_gives_the_published_baseline_but_all_come_near(term: MirrorTerm) -> None:
    off = abs(baseline_mm(paper.MIRROR_TILT_DEG, term) - paper.PUBLISHED_BASELINE_MM)
    assert 0.1 < off < 0.3


@EVERY
@given(field_deg=st.floats(1, 59), near_edge_mm=st.floats(1, 100), mirror_length_mm=st.floats(1, 200))
def test_at_the_upper_bound_every_variant_is_twice_the_near_edge(
    term: MirrorTerm, field_deg: float, near_edge_mm: float, mirror_length_mm: float
) -> None:
    _, bound = paper.mirror_tilt_bounds_deg(field_deg)
    found = baseline_mm(
        bound, term, field_deg=field_deg, near_edge_mm=near_edge_mm, mirror_length_mm=mirror_length_mm
    )  # fmt: skip
    assert found == pytest.approx(2 * near_edge_mm, rel=1e-9)


@pytest.mark.parametrize("term", FOUR, ids=lambda term: term.name.lower())
def test_adding_the_far_end_is_not_what_the_paper_computed(term: MirrorTerm) -> None:
    assert 52.85 < baseline_mm(paper.MIRROR_TILT_DEG, term, far_end_sign=1) < 53.45
    assert 48.25 < baseline_mm(paper.MIRROR_TILT_DEG, term, denominator_sign=1) < 48.75


def test_the_baseline_changes_as_the_reference_says() -> None:
    by_tilt = (baseline_mm(49.301) - baseline_mm(49.299)) / 0.002
    assert by_tilt == pytest.approx(-19, abs=0.5)
    assert slope("field_deg", 17.0, 1e-3) == pytest.approx(4.8, abs=0.1)
    assert slope("near_edge_mm", 25.4, 1e-3) == pytest.approx(2.000, abs=0.0005)
    assert slope("mirror_length_mm", 76.2, 1e-3) == pytest.approx(-0.013, abs=0.0005)


def test_the_rounding_of_the_tilt_covers_the_published_and_the_calibrated_baseline() -> None:
    spans = [(baseline_mm(49.35, term), baseline_mm(49.25, term)) for term in MirrorTerm]
    assert min(low for low, _ in spans) < paper.CALIBRATED_BASELINE_MM < paper.PUBLISHED_BASELINE_MM
    assert all(high == pytest.approx(50.8) for _, high in spans)


def test_the_published_tilt_lies_past_its_own_bound() -> None:
    _, bound = paper.mirror_tilt_bounds_deg(paper.FIELD_DEG)
    assert paper.MIRROR_TILT_DEG - bound == pytest.approx(0.05)


@given(field_deg=st.floats(1, 59))
def test_the_bounds_are_where_the_edge_ray_stands_upright_and_level(field_deg: float) -> None:
    lower, upper = paper.mirror_tilt_bounds_deg(field_deg)
    edge = paper.edge_incidence_deg(field_deg)
    assert paper.ray_angle_deg(edge, lower) == pytest.approx(90)
    assert paper.ray_angle_deg(edge, upper) == pytest.approx(0)


@pytest.mark.parametrize("field_angle_deg", [0.0, 5.0, 17.0])
@pytest.mark.parametrize("mirror_angle_deg", [55.0, 56.6, 59.0])
def test_the_angle_of_the_ray_is_exact_for_the_real_prism(
    dslr: Rig, field_angle_deg: float, mirror_angle_deg: float
) -> None:
    # the paper's theta: from the x axis; beta: from the reflecting face, to which a mirror at 60 degrees is parallel
    rig = msgspec.structs.replace(dslr, mirrors=msgspec.structs.replace(dslr.mirrors, angle_deg=mirror_angle_deg))
    _, out = fold(rig, "left").rays(np.array([[np.tan(np.radians(field_angle_deg)), 0.0]]))
    outward_deg = np.degrees(np.arctan2(out[0, 2], -out[0, 0]))
    theta = paper.ray_angle_deg(60 - field_angle_deg, 60 - mirror_angle_deg)
    assert outward_deg == pytest.approx(theta, abs=1e-9)


@pytest.mark.parametrize("field_deg", [0.0, 60.0, 90.0, -5.0])
def test_a_field_outside_of_the_formulas_is_refused(field_deg: float) -> None:
    with pytest.raises(UsageError, match="between 0 and 60"):
        paper.mirror_tilt_bounds_deg(field_deg)


def test_parallel_rays_have_no_baseline() -> None:
    with pytest.raises(UsageError, match="parallel"):
        baseline_mm(30.0, field_deg=0.0)
