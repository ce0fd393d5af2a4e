"""The figures of the built-in rigs against the reference's section 3, and each figure against physics on its own.

The reference's table was made by another tracer on a coarser grid of rays and rounded; where a figure deviates by more
than the rounding, the reason stands beside its tolerance.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from prismstereo_hw.errors import RigError
from prismstereo_hw.optics.figures import common_width_mm, figures, kept_slopes
from prismstereo_hw.optics.trace import trace, view_fates
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig

REFERENCE = {
    "dslr-35mm": {
        "baseline": 49.6, "vergence": 4.1, "field": (-6.7, 10.9), "kept": 1.00, "seam": 156, "focal": 2009,
        "residual": 0.036, "from": 207, "widths": (146, 289, 525), "steps": (0.63, 2.5, 10.0), "lost": 0.0,
    },
    "oak-1": {
        "baseline": 50.2, "vergence": 2.1, "field": (-13.5, 15.6), "kept": 0.816, "seam": 76, "focal": 935,
        "residual": 0.16, "from": 157, "widths": (235, 514, 1015), "steps": (1.3, 5.3, 21.3), "lost": 0.184,
    },
    "pi-camera-v2": {
        "baseline": 50.2, "vergence": 2.1, "field": (-13.5, 15.5), "kept": 0.925, "seam": 58, "focal": 1061,
        "residual": 0.16, "from": 159, "widths": (235, 513, 1016), "steps": (1.2, 4.7, 18.8), "lost": 0.075,
    },
}  # fmt: skip


def test_the_figures_are_those_of_the_reference(rig: Rig) -> None:
    ours, said = figures(rig), REFERENCE[rig.name]
    assert ours.baseline_mm == pytest.approx(said["baseline"], abs=0.05)
    assert ours.focal_px == pytest.approx(said["focal"], abs=0.5)
    assert ours.columns_kept == pytest.approx(said["kept"], abs=0.002)  # one column of 640 is 0.0016
    assert sum(ours.lost.values()) == pytest.approx(said["lost"], abs=0.002)
    assert ours.viewpoint_residual_mm == pytest.approx(said["residual"], abs=0.003)
    # fields and vergence: the reference's rays begin up to 0.1 degree inside of the seam, ours half a pixel from it
    assert ours.half_field_deg == pytest.approx(said["field"], abs=0.12)
    assert ours.vergence_deg == pytest.approx(said["vergence"], abs=0.12)
    # the same rays limit the common width and where the overlap begins, by a hundredth
    assert ours.overlap_from_mm == pytest.approx(said["from"], rel=0.025)
    assert ours.overlap_to_mm == math.inf
    assert list(ours.common_width_mm.values()) == pytest.approx(said["widths"], rel=0.008)
    assert list(ours.depth_step_mm.values()) == pytest.approx(said["steps"], rel=0.03)  # its first are given to 0.1
    # the seam: the reference's pupil samples lie on the rim as well, which adds two columns; see the sampled pupil below
    assert ours.seam_px == pytest.approx(said["seam"], rel=0.035)


def test_the_baseline_of_the_rays_exceeds_that_of_the_axis_by_what_the_glass_adds(dslr: Rig, oak: Rig) -> None:
    for rig, excess_mm in ((dslr, 0.04), (oak, 0.24)):
        ours = figures(rig)
        assert ours.baseline_mm - ours.baseline_paraxial_mm == pytest.approx(excess_mm, abs=0.01)


def test_no_ray_of_the_middle_row_passes_the_viewpoint_further_away_than_the_residual(rig: Rig) -> None:
    ours = figures(rig)
    slopes, _ = kept_slopes(rig)
    origin, direction = fold(rig, "left").rays(slopes)
    x, z = ours.viewpoint_mm
    apart = np.linalg.norm(np.cross(np.array([x, 0.0, z]) - origin, direction), axis=1)
    assert apart.max() == pytest.approx(ours.viewpoint_residual_mm, rel=1e-6)
    nudged = [
        np.linalg.norm(np.cross(np.array([x + dx, 0.0, z + dz]) - origin, direction), axis=1)
        for dx, dz in ((0.01, 0), (-0.01, 0), (0, 0.01), (0, -0.01))
    ]
    assert all(np.sum(other**2) > np.sum(apart**2) for other in nudged)


def test_the_columns_that_are_kept_are_those_whose_rays_come_through(rig: Rig) -> None:
    lens, video = rig.lens(), rig.camera.video
    columns = np.arange(video.width // 2, video.width, dtype=float)
    slopes = lens.slopes(np.stack([columns, np.full_like(columns, lens.cy_px)], axis=-1))
    through = view_fates(rig, "left", slopes).fate == 0
    assert figures(rig).columns_kept == pytest.approx(through.mean())
    assert np.all(np.diff(through.astype(int)) <= 0)  # lost columns are the outer ones


def test_the_outer_columns_are_lost_because_nothing_is_totally_reflected_there(rig: Rig) -> None:
    lost = figures(rig).lost
    assert set(lost) <= {"is not totally reflected at the reflecting face"}
    assert bool(lost) == (rig.camera.hfov_deg > 58.4)  # N-BK7's limit


def test_flint_keeps_all_columns_of_a_wide_camera(oak: Rig) -> None:
    flint = msgspec.structs.replace(oak, prism=msgspec.structs.replace(oak.prism, glass="1.62"))
    assert figures(flint).columns_kept == 1.0


@pytest.mark.parametrize("distance_mm", [300.0, 500.0, 1000.0, 2000.0])
def test_both_views_see_the_common_width_and_no_more(rig: Rig, distance_mm: float) -> None:
    half = common_width_mm(rig, distance_mm) / 2
    kept = np.sort(kept_slopes(rig)[0][:, 0])

    def seen_by_both(x: float) -> bool:
        u = fold(rig, "left").slopes(np.array([[x, 0.0, distance_mm], [-x, 0.0, distance_mm]]))[:, 0]
        return bool(np.all((u >= kept[0] - 1e-12) & (u <= kept[-1] + 1e-12)))

    assert seen_by_both(half - 1e-6)
    assert not seen_by_both(half + 0.01)


def test_the_common_width_in_the_figures_is_the_exact_one_to_half_a_percent(rig: Rig) -> None:
    # the figures look from the best common point, the exact width follows each ray
    for distance, width in figures(rig).common_width_mm.items():
        assert width == pytest.approx(common_width_mm(rig, float(distance)), rel=0.005)


def test_where_the_overlap_begins_half_of_a_view_is_common(rig: Rig) -> None:
    ours = figures(rig)
    x, z = ours.viewpoint_mm
    outer, inner = (x + (ours.overlap_from_mm - z) * math.tan(math.radians(angle)) for angle in ours.half_field_deg)
    assert 2 * min(inner, -outer) == pytest.approx(0.5 * (inner - outer), rel=1e-6)


def test_steeper_mirrors_end_the_overlap_where_the_seam_rays_part(dslr: Rig) -> None:
    # reference: mu >= 60 ends it at (B / 2) / tan(2 mu - 120); half of the width is lost earlier
    steep = msgspec.structs.replace(dslr, mirrors=msgspec.structs.replace(dslr.mirrors, angle_deg=61.0))
    ours = figures(steep)
    apart = ours.baseline_mm / 2 / math.tan(math.radians(2.0))
    assert ours.overlap_from_mm < ours.overlap_to_mm < apart
    assert common_width_mm(steep, 0.98 * (apart + ours.viewpoint_mm[1])) > 0
    assert common_width_mm(steep, 1.03 * (apart + ours.viewpoint_mm[1])) == 0


def test_a_depth_step_is_a_quarter_pixel(rig: Rig) -> None:
    ours = figures(rig)
    for distance, step in ours.depth_step_mm.items():
        z = float(distance)
        disparity = ours.focal_px * ours.baseline_mm / z
        assert ours.focal_px * ours.baseline_mm / (disparity - 0.25) - z == pytest.approx(step, rel=0.02)


def test_the_seam_is_as_wide_as_a_sampled_pupil_makes_it(rig: Rig) -> None:
    # rays from points all over the pupil, focus at infinity: a column is ghosted when less than 90 % of them take the
    # face that its middle ray takes
    lens = rig.lens()
    reach = ((np.arange(61) + 0.5) / 61 - 0.5) * rig.camera.pupil_diameter_mm
    pupil = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
    pupil = pupil[np.hypot(pupil[:, 0], pupil[:, 1]) <= rig.camera.pupil_diameter_mm / 2]
    columns = lens.cx_px + np.arange(0.5, 120)
    slopes = lens.slopes(np.stack([columns, np.full_like(columns, lens.cy_px)], axis=-1))
    direction = np.column_stack([slopes, np.ones(len(slopes))])
    direction = (direction / np.linalg.norm(direction, axis=1, keepdims=True))[:, None]
    start = np.column_stack([pupil, np.zeros(len(pupil))])
    proper = trace(
        rig.surfaces("left")[:2], np.broadcast_to(start, (len(columns), *start.shape)),
        np.broadcast_to(direction, (len(columns), *start.shape)),
    ).fate == 0  # fmt: skip
    ghosted = np.count_nonzero(proper.mean(axis=1) < 0.9)
    assert 2 * ghosted == pytest.approx(figures(rig).seam_px, abs=3.0)


def test_a_larger_pupil_ghosts_a_wider_band(dslr: Rig) -> None:
    wide_open = msgspec.structs.replace(dslr, camera=msgspec.structs.replace(dslr.camera, pupil_diameter_mm=8.75))
    assert figures(wide_open).seam_px == pytest.approx(2 * figures(dslr).seam_px)


def test_a_rig_that_shows_nothing_is_refused(oak: Rig) -> None:
    blind = msgspec.structs.replace(oak, mirrors=msgspec.structs.replace(oak.mirrors, offset_mm=1000.0))
    with pytest.raises(RigError, match="rig 'oak-1' shows nothing"):
        figures(blind)
