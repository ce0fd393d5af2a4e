"""The sampled pupil: the ghosted band at the seam, the blur of what is out of focus, and vignetting."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from prismstereo_hw.errors import UsageError
from prismstereo_hw.kinds import PrismRig
from prismstereo_hw.optics.figures import figures
from prismstereo_hw.optics.trace import trace
from prismstereo_hw.pupil import Pupil, blended_px
from prismstereo_hw.rig import Mode
from prismstereo_hw.scene import Rectangle, Scene, facing_plane
from prismstereo_hw.texture import Plain
from prismstereo_hw.twin import Twin

X, Y, _ = np.eye(3)


@pytest.fixture(scope="module")
def ribbon(dslr: PrismRig) -> PrismRig:
    """The DSLR rig with mirrors that lose nothing of the pupil, read out as 48 rows: quick, and as wide as ever."""
    mirrors = msgspec.structs.replace(dslr.mirrors, length_mm=90.0)
    camera = msgspec.structs.replace(dslr.camera, video=Mode(width=1280, height=48, rate_hz=30.0))
    return msgspec.structs.replace(dslr, camera=camera, mirrors=mirrors)


def halves(right_grey: float, left_grey: float, z_mm: float = 3000.0, edge_mm: float = 0.0) -> Scene:
    """Two endless half planes that meet in the line x = edge_mm."""
    sheets = [
        Rectangle(name, np.array([edge_mm + sign * 1e6, 0.0, z_mm]), X, Y, 1e6, 1e6, Plain(grey))
        for name, sign, grey in (("right", 1, right_grey), ("left", -1, left_grey))
    ]
    return Scene("halves", tuple(sheets))


def own_share(cut: np.ndarray) -> np.ndarray:
    """The part of a disc on the far side of a chord at -cut radii from its middle: what a column gets of its own view."""
    cut = np.clip(cut, -1, 1)
    return 1 - (np.arccos(cut) - cut * np.sqrt(1 - cut**2)) / np.pi


def test_near_the_seam_each_pixel_mixes_both_views_by_the_share_of_the_pupil(ribbon: PrismRig) -> None:
    # at 3 m the seam rays of the left view meet x > 0 or x < 0 according to its side: two greys, one for each view
    pupil = Pupil(40, focus_mm=math.inf)
    pictures = [
        Twin(ribbon, halves(*greys), noise=0.0, pupil=pupil).frame().pixels[24].astype(float)
        for greys in ((200.0, 40.0), (40.0, 200.0))
    ]
    sharp = Twin(ribbon, halves(200.0, 40.0), noise=0.0).frame().pixels[24].astype(float)
    off = np.arange(1280) - ribbon.lens().cx_px
    inside = np.abs(off) < blended_px(ribbon) / 2
    left_view, right_view = sharp[700], sharp[580]
    assert {left_view, right_view} == {200.0, 40.0}

    share = own_share(np.abs(off) / (blended_px(ribbon) / 2))
    of_left = np.where(off > 0, share, 1 - share)
    np.testing.assert_allclose(pictures[0][inside], (of_left * left_view + (1 - of_left) * right_view)[inside], atol=3)
    np.testing.assert_allclose(pictures[0] + pictures[1], 240, atol=1)  # no light is lost: the views share it
    np.testing.assert_array_equal(pictures[0][~inside], sharp[~inside])


def test_the_ghosted_band_is_as_wide_as_the_figures_promise(ribbon: PrismRig) -> None:
    twin = Twin(ribbon, halves(200.0, 40.0), noise=0.0, pupil=Pupil(80, focus_mm=math.inf))
    row = twin.frame().pixels[24].astype(float)
    edge = int(blended_px(ribbon) / 2) + 2
    band, own = row[640 - edge : 640 + edge], np.repeat([row[639 - edge], row[640 + edge]], edge)
    proper = 1 - np.abs(band - own) / 160
    assert np.count_nonzero(proper < 0.9) == pytest.approx(figures(ribbon).seam_px, abs=3)


def test_a_lens_focused_near_blends_fewer_columns(ribbon: PrismRig) -> None:
    widths = []
    for focus_mm in (400.0, math.inf):
        twin = Twin(ribbon, halves(200.0, 40.0), noise=0.0, pupil=Pupil(40, focus_mm=focus_mm))
        row = twin.frame().pixels[24].astype(float)
        widths.append(np.count_nonzero((row > 48) & (row < 192)))
    # rays of one pixel converge, so the beam is narrower by z / focus where the edge cuts it
    assert widths[0] / widths[1] == pytest.approx(1 - ribbon.split_edge_mm / 400.0, abs=0.02)


@pytest.mark.parametrize("focus_mm", [250.0, 900.0])
def test_what_is_out_of_focus_is_blurred_by_the_image_of_the_pupil(ribbon: PrismRig, focus_mm: float) -> None:
    camera = msgspec.structs.replace(ribbon.camera, video=Mode(width=640, height=48, rate_hz=30.0))
    rig, scene = msgspec.structs.replace(ribbon, camera=camera), halves(200.0, 40.0, z_mm=900.0, edge_mm=20.0)
    truth = Twin(rig, scene).truth()
    edge = int(np.argmax(np.diff(truth.objects[24].astype(int)) != 0))
    depth = float(truth.depth_mm[24, edge])  # from the pinhole, as a focus is
    focus_mm = focus_mm - 900.0 + depth
    row = Twin(rig, scene, noise=0.0, pupil=Pupil(96, defocus=True, focus_mm=focus_mm)).frame().pixels[24]
    spread = np.abs(np.diff(row[320 + edge - 20 : 320 + edge + 21].astype(float))) / 160
    assert spread.sum() == pytest.approx(1.0, abs=0.02)
    at = np.arange(len(spread))
    middle = spread @ at / spread.sum()
    sigma_px = math.sqrt(spread @ (at - middle) ** 2 / spread.sum())
    disc_px = rig.lens().fx_px * rig.camera.pupil_diameter_mm * abs(1 / depth - 1 / focus_mm)
    assert sigma_px == pytest.approx(disc_px / 4, rel=0.05, abs=0.3)  # a disc seen from its side


def test_vignetting_is_the_share_of_the_pupil_that_gets_lost(dslr: PrismRig) -> None:
    # a mirror too short at its far end, where the columns beside the seam look
    mirrors = msgspec.structs.replace(dslr.mirrors, length_mm=34.0)
    camera = msgspec.structs.replace(dslr.camera, video=Mode(width=320, height=48, rate_hz=30.0))
    rig = msgspec.structs.replace(dslr, mirrors=mirrors, camera=camera)
    white = Scene("white", (Rectangle("wall", np.array([0.0, 0.0, 1e4]), X, Y, np.inf, np.inf, Plain(200.0)),))
    twin = Twin(rig, white, noise=0.0, pupil=Pupil(100, defocus=True, focus_mm=math.inf))
    row = twin.frame().pixels[24].astype(float) / 200

    rng = np.random.default_rng(5)
    angle, radius = rng.uniform(0, 2 * np.pi, 4000), np.sqrt(rng.uniform(0, 1, 4000)) * rig.camera.pupil_diameter_mm / 2
    start = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(4000)], axis=-1)
    for column in (0, 60, 140, 155, 160, 165, 175, 185, 200, 260, 319):
        slope = rig.lens().slopes(np.array([float(column), 24.0]))
        direction = np.broadcast_to(np.array([*slope, 1.0]) / np.linalg.norm([*slope, 1.0]), start.shape)
        comes = [trace(rig.surfaces(side), start, direction).fate == 0 for side in ("left", "right")]
        assert row[column] == pytest.approx((comes[0] | comes[1]).mean(), abs=0.03)
    assert row.min() < 0.5
    assert row[[30, 290]].min() == 1.0


def test_one_sample_in_the_middle_is_the_pinhole(small: PrismRig) -> None:
    scene = facing_plane(small, 900.0)
    pinhole, sampled = Twin(small, scene), Twin(small, scene, pupil=Pupil(1, defocus=True, focus_mm=500.0))
    np.testing.assert_array_equal(pinhole.frame().pixels, sampled.frame().pixels)


@pytest.mark.parametrize("defocus", [False, True])
@pytest.mark.parametrize("samples", [2, 9, 64])
def test_pupil_points_stand_for_equal_areas_of_the_disc(samples: int, defocus: bool) -> None:
    points = Pupil(samples, defocus=defocus).points_mm(4.0)
    assert points.shape == (samples, 2)
    assert np.hypot(*points.T).max() <= 2.0
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=1.2 / samples)
    if samples == 64:  # a disc of radius 2 has a mean square of 1 along each axis
        assert np.mean(points[:, 0] ** 2) == pytest.approx(1.0, abs=0.03)


def test_the_focus_is_in_the_middle_of_the_range_unless_told(dslr: PrismRig) -> None:
    assert Pupil().focused_mm(dslr) == pytest.approx(800.0)  # 400 mm to infinity
    assert Pupil(focus_mm=650.0).focused_mm(dslr) == 650.0


@pytest.mark.parametrize(("samples", "focus_mm"), [(0, None), (100_000, None), (8, 0.0), (8, -3.0), (8, math.nan)])
def test_a_pupil_that_cannot_be_sampled_is_refused(samples: int, focus_mm: float | None) -> None:
    with pytest.raises(UsageError, match="give"):
        Pupil(samples, focus_mm=focus_mm)
