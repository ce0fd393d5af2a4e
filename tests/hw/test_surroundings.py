"""Warmth, a breathing lens, dust and drops: each by its physics."""

from __future__ import annotations

import math

import cv2
import msgspec
import numpy as np
import pytest

from prismstereo_hw.errors import UsageError
from prismstereo_hw.kinds import PrismRig
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import Rectangle, Scene, facing_plane
from prismstereo_hw.surroundings import EXPANSION_PER_K, Spot, Surroundings, seeded_spots
from prismstereo_hw.texture import Plain
from prismstereo_hw.twin import Twin

X, Y, _ = np.eye(3)
WHITE = Scene("white", (Rectangle("wall", np.array([0.0, 0.0, 900.0]), X, Y, np.inf, np.inf, Plain(200.0)),))


def baseline_mm(rig: PrismRig, growth: float) -> float:
    """The paraxial baseline by the closed form, with the mount's three lengths longer by a factor."""
    prism, mu = rig.prism, math.radians(rig.mirrors.angle_deg)
    x, up, d = (growth * value for value in (rig.mirrors.near_edge_mm, rig.mirrors.offset_mm, prism.pupil_to_prism_mm))
    delta, s = prism.height_mm * (1 - 1 / prism.index), math.sin(math.pi / 3)
    q = d + prism.height_mm - delta
    return 2 * (-q * s + 2 * math.sin(mu) * (math.sin(mu) * (q * s + x) + math.cos(mu) * (delta + q / 2 - d - up)))


@pytest.mark.parametrize(("material", "kelvin"), [("petg", 40.0), ("petg", -25.0), ("aluminium", 40.0)])
def test_a_warm_mount_moves_the_mirrors_and_with_them_the_baseline(rig: PrismRig, material: str, kelvin: float) -> None:
    per_k = EXPANSION_PER_K[material]
    warm = Surroundings(temperature_c=20.0 + kelvin, expansion_per_k=per_k)
    standing = Twin(rig, WHITE, surroundings=warm).standing
    found = fold(standing, "right").centre_mm[0] - fold(standing, "left").centre_mm[0]
    assert found == pytest.approx(baseline_mm(rig, 1 + per_k * kelvin), abs=1e-9)
    grown = found - baseline_mm(rig, 1.0)
    assert math.copysign(1, grown) == math.copysign(1, kelvin)
    assert 0.2 < grown / (50 * per_k * kelvin) < 2  # of the order of the baseline's own growth


def test_the_depth_of_the_truth_follows_the_warm_rig(small: Rig) -> None:
    scene, hot = facing_plane(small, 900.0), Surroundings(temperature_c=60.0)
    cold, warm = Twin(small, scene).truth(), Twin(small, scene, surroundings=hot).truth()
    moved = fold(hot.applied(small), "left").centre_mm[2] - fold(small, "left").centre_mm[2]
    assert np.nanmedian(warm.depth_mm - cold.depth_mm) == pytest.approx(-moved, abs=0.01)
    assert abs(moved) > 0.01


def test_only_a_prism_rig_has_a_mount_that_grows() -> None:
    plate = Rig.read("plate")
    assert Surroundings().applied(plate) is plate
    with pytest.raises(UsageError, match=r"'plate' is no prism rig.*leave temperature_c at 20"):
        Surroundings(temperature_c=30.0).applied(plate)


def test_focus_breathing_scales_the_picture_about_the_optical_axis(small: Rig) -> None:
    camera = msgspec.structs.replace(small.camera, principal_offset_px=(3.0, -2.0), distortion=(-0.05, 0.01))
    rig = msgspec.structs.replace(small, camera=camera)
    focused = Surroundings(lens_position=140, nominal_lens_position=120, breathing_per_step=-4e-4)
    twin = Twin(rig, facing_plane(rig, 900.0), surroundings=focused)
    before, after = rig.lens(), twin.standing.lens()
    slopes = np.array([[0.1, 0.05], [-0.3, 0.1], [0.2, -0.15], [0.0, 0.0]])
    centre = np.array([before.cx_px, before.cy_px])
    np.testing.assert_allclose(
        after.project_slopes(slopes) - centre, (1 - 20 * 4e-4) * (before.project_slopes(slopes) - centre), atol=1e-9
    )
    assert twin.frame().lens_position == 140
    assert Twin(rig, WHITE).frame().lens_position is None


def test_a_lens_at_its_nominal_position_is_as_calibrated(small: Rig) -> None:
    assert Surroundings(lens_position=120, nominal_lens_position=120, breathing_per_step=1e-3).applied(small) is small
    with pytest.raises(UsageError, match="leaves no focal length"):
        Surroundings(lens_position=2000, breathing_per_step=-1e-3).applied(small)


def test_dust_darkens_one_view_at_one_place_of_the_sensor(small: Rig) -> None:
    spot = Spot("left", x_px=230.0, y_px=90.0, radius_px=12.0, dark=0.4)
    clean, dusty = (
        Twin(small, WHITE, noise=0.0, surroundings=Surroundings(spots=spots)).frame().pixels.astype(float)
        for spots in ((), (spot,))
    )
    y, x = (axis.astype(float) for axis in np.mgrid[0:180, 0:320])
    away = np.hypot(x - 230, y - 90)
    assert dusty[90, 230] == pytest.approx(0.6 * clean[90, 230], abs=0.5)
    np.testing.assert_array_equal(dusty[away >= 12], clean[away >= 12])
    profile = dusty[90, 230:243]
    assert np.all(np.diff(profile) >= 0)

    scene = facing_plane(small, 700.0)  # and whatever it looks at, it stays there
    before, behind = (
        Twin(small, scene, noise=0.0, surroundings=Surroundings(spots=spots)).frame().pixels.astype(float)
        for spots in ((), (spot,))
    )
    np.testing.assert_allclose(behind, before * (dusty / np.maximum(clean, 1)), atol=2)


def test_dust_on_the_sensor_s_picture_lies_in_the_still_where_the_still_shows_that_place(small: Rig) -> None:
    spot = Spot("right", x_px=80.0, y_px=60.0, radius_px=10.0, dark=0.5)
    still = Mode(width=640, height=480)  # twice as fine, and taller: 60 rows more above and below
    frame = Twin(small, WHITE, mode=still, noise=0.0, surroundings=Surroundings(spots=(spot,))).frame()
    rows, columns = np.nonzero(frame.pixels[100:300, 130:300] < 150)
    assert len(rows) > 50
    assert rows.mean() + 100 == pytest.approx(2 * 60.5 - 0.5 + 60, abs=0.1)
    assert columns.mean() + 130 == pytest.approx(2 * 80.5 - 0.5, abs=0.1)


@pytest.mark.parametrize("bend", [0.4, -0.3])
def test_a_drop_is_a_small_lens(oak: Rig, bend: float) -> None:
    mode, scene = Mode(width=1280, height=180), facing_plane(oak, 700.0)
    spot = Spot("left", x_px=900.0, y_px=360.0, radius_px=60.0, bend=bend)  # video rows 270 to 449 are read
    clean, wet = (
        Twin(oak, scene, mode=mode, noise=0.0, surroundings=Surroundings(spots=spots)).frame().pixels.astype(np.float32)
        for spots in ((), (spot,))
    )
    y, x = (axis.astype(float) for axis in np.mgrid[30:150, 840:960])
    seen = spot.looks_at(np.stack([x, y + 270], axis=-1)) - [0, 270]
    expected = cv2.remap(clean, *np.moveaxis(seen.astype(np.float32), -1, 0), cv2.INTER_CUBIC)
    assert np.sqrt(np.mean((wet[30:150, 840:960] - expected) ** 2)) < 1.5
    assert np.sqrt(np.mean((clean[30:150, 840:960] - expected) ** 2)) > 5
    outside = np.hypot(x - 900, y - 90) >= 60
    np.testing.assert_array_equal(wet[30:150, 840:960][outside], clean[30:150, 840:960][outside])
    np.testing.assert_array_equal(wet[:, :640], clean[:, :640])

    middle = np.array([[899.0, 360.0], [901.0, 360.0]])  # the middle is magnified by 1 / (1 - bend)
    assert np.ptp(spot.looks_at(middle)[:, 0]) == pytest.approx(2 * (1 - bend), rel=1e-3)


def test_seeded_spots_lie_within_their_views(rig: Rig) -> None:
    spots = seeded_spots(rig, seed=3, dust=20, drops=10)
    assert spots == seeded_spots(rig, seed=3, dust=20, drops=10)
    assert spots != seeded_spots(rig, seed=4, dust=20, drops=10)
    assert [bool(spot.dark) for spot in spots] == 20 * [True] + 10 * [False]
    for spot in spots:
        x, y, w, h = rig.views[spot.side == "right"].rectangle(rig.camera.video.width, rig.camera.video.height)
        assert x < spot.x_px < x + w
        assert y < spot.y_px < y + h


@pytest.mark.parametrize(("radius_px", "dark", "bend"), [(0.0, 0.5, 0.0), (5.0, 1.5, 0.0), (5.0, 0.0, 0.9)])
def test_a_spot_that_there_is_not_is_refused(radius_px: float, dark: float, bend: float) -> None:
    with pytest.raises(UsageError, match="give a positive radius"):
        Spot("left", 10.0, 10.0, radius_px, dark=dark, bend=bend)
