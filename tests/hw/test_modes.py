"""Video and stills of one sensor: where a point goes from one to the other, and when stills are taken."""

from __future__ import annotations

import itertools

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prismstereo_hw.modes import from_video, still_from_video, still_instants_us, still_pixels
from prismstereo_hw.optics.sight import sight
from prismstereo_hw.rig import LITERATURE, Mode, Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin


def check_points(rig: Rig) -> None:
    rng = np.random.default_rng(3)
    for side in ("left", "right"):
        view = sight(rig, side)
        slopes = np.stack([rng.uniform(-0.1, 0.1, 50), rng.uniform(-0.08, 0.08, 50)], axis=-1)
        origin, direction = view.rays(slopes)
        seen = view.slopes(origin + rng.uniform(300, 3000, (50, 1)) * direction)
        video, still = rig.lens().project_slopes(seen), rig.lens(rig.camera.still).project_slopes(seen)
        np.testing.assert_allclose(still_pixels(rig, video), still, rtol=0, atol=1e-9)


def test_a_point_lies_in_the_still_where_scale_and_offset_put_it(rig: Rig) -> None:
    check_points(rig)


def test_that_holds_for_an_axis_off_the_middle_and_a_lens_that_distorts(rig: Rig) -> None:
    camera = msgspec.structs.replace(rig.camera, principal_offset_px=(17.3, -8.1), distortion=(-0.12, 0.03))
    check_points(msgspec.structs.replace(rig, camera=camera))


@pytest.mark.parametrize("name", LITERATURE)
def test_that_holds_for_every_rig_of_the_literature(name: str) -> None:
    rig = Rig.read(name)
    lens, own = rig.lens(), rig.lens(rig.camera.still)
    slopes = np.array([[0.1, 0.05], [-0.12, 0.0], [0.0, -0.07]])
    np.testing.assert_allclose(still_pixels(rig, lens.project_slopes(slopes)), own.project_slopes(slopes), atol=1e-9)


def test_the_paper_s_still_is_3_7_times_as_fine_and_taller_than_its_video(dslr: Rig) -> None:
    scale, dx_px, dy_px = still_from_video(dslr)
    assert scale == pytest.approx(3.7125)
    assert dx_px == pytest.approx(0.0, abs=1e-9)
    assert dy_px == pytest.approx((3168 - 3.7125 * 720) / 2)  # 247.5 rows above the video's window
    np.testing.assert_allclose(still_pixels(dslr, np.array([-0.5, -0.5])), [-0.5, 247.0])  # the window's corner
    assert from_video(dslr, dslr.camera.video) == pytest.approx((1.0, 0.0, 0.0))


def test_a_still_shows_a_plane_where_the_video_shows_it(small: Rig) -> None:
    camera = msgspec.structs.replace(small.camera, still=Mode(width=960, height=720))
    rig = msgspec.structs.replace(small, camera=camera)
    scene = facing_plane(rig, 800.0)
    video = Twin(rig, scene, noise=0.0).frame().pixels.astype(float)
    still = Twin(rig, scene, mode=camera.still, noise=0.0).frame().pixels.astype(float)
    rows, columns = (axis.ravel() for axis in np.mgrid[20:160, 170:270])
    at = still_pixels(rig, np.stack([columns, rows], axis=-1).astype(float))
    np.testing.assert_allclose(at, np.rint(at), atol=1e-9)  # a scale of 3 puts centres on centres
    there = still[np.rint(at[:, 1]).astype(int), np.rint(at[:, 0]).astype(int)]
    moved = still[np.rint(at[:, 1]).astype(int), np.rint(at[:, 0]).astype(int) + 3]
    here = video[rows, columns]
    assert np.corrcoef(here, there)[0, 1] > 0.96  # the still has detail that the video has not
    assert np.corrcoef(here, there)[0, 1] > np.corrcoef(here, moved)[0, 1] + 0.03


@given(count=st.integers(0, 200), seed=st.integers(0, 2**31))
def test_stills_are_never_nearer_than_a_second(count: int, seed: int) -> None:
    instants = still_instants_us(count, seed)
    assert len(instants) == count
    assert all(later - earlier >= 1_000_000 for earlier, later in itertools.pairwise(instants))
    assert instants == still_instants_us(count, seed)


def test_stills_come_at_irregular_instants() -> None:
    gaps = np.diff(still_instants_us(60, seed=4))
    assert gaps.std() > 200_000
    assert len(np.unique(gaps)) == len(gaps)
