"""Textures: detail at every distance, none that aliases, the same for both views at sub-pixel shifts."""

from __future__ import annotations

import numpy as np
import pytest

from prismstereo_hw.texture import Checkered, Noise, Plain

TEXEL_MM = 0.25


def row(texture: Noise, u_mm: np.ndarray, pixel_mm: float, v_mm: float = 3.1) -> np.ndarray:
    return texture.shade(u_mm, np.full(u_mm.shape, v_mm), np.full(u_mm.shape, pixel_mm))


def patch(texture: Noise, pixel_mm: float, at_mm: np.ndarray) -> np.ndarray:
    """Grey levels on a square grid of surface points, seen by pixels of a size."""
    u, v = (axis.ravel() for axis in np.meshgrid(at_mm, at_mm))
    return texture.shade(u, v, np.full(u.size, pixel_mm)).reshape(len(at_mm), len(at_mm))


@pytest.mark.parametrize("pixel_mm", [0.5, 0.6, 0.9, 1.3, 2.0, 3.7, 9.0])
def test_next_to_nothing_finer_than_a_pixel_is_left(pixel_mm: float) -> None:
    # four samples a pixel see whatever is there; half a cycle per pixel is the most that the pixels themselves can carry
    grey = patch(Noise(seed=3, texel_mm=TEXEL_MM), pixel_mm, np.arange(256) * pixel_mm / 4)
    window = np.hanning(256)[:, None] * np.hanning(256)
    spectrum = np.abs(np.fft.fft2((grey - grey.mean()) * window)) ** 2
    cycles = np.abs(np.fft.fftfreq(256)) * 4  # per pixel
    beyond = np.maximum(cycles[:, None], cycles) > 0.5
    # 0.03 to 0.35 %, most just below a whole level of blur: 1.4 grey levels, as much as the sensor's noise
    assert spectrum[beyond].sum() / spectrum.sum() < 5e-3


@pytest.mark.parametrize("pixel_mm", [0.5, 1.0, 2.0, 4.0, 8.0])
def test_there_is_detail_at_every_distance(pixel_mm: float) -> None:
    grey = patch(Noise(seed=3, texel_mm=TEXEL_MM), pixel_mm, np.arange(128) * pixel_mm)
    slope = np.diff(grey, axis=1)
    assert grey.std() > 10
    assert np.sqrt(np.mean(slope**2)) > 2  # grey levels per pixel: what a matcher lives on


@pytest.mark.parametrize("pixel_mm", [0.35, 0.7, 1.4, 2.8, 5.6])
def test_a_coarser_look_is_the_finer_one_blurred_and_not_moved(pixel_mm: float) -> None:
    at = np.arange(160) * pixel_mm * 0.5
    texture = Noise(seed=5, texel_mm=TEXEL_MM)
    fine, coarse = patch(texture, pixel_mm, at), patch(texture, 2 * pixel_mm, at)
    # contrast is the same in every octave: of the six to three that the fine look has, the coarse one lacks one
    assert np.corrcoef(fine.ravel(), coarse.ravel())[0, 1] > 0.75
    for axis in (0, 1):
        slope = np.gradient(coarse, axis=axis)
        rest = fine - coarse
        steps = -np.sum(slope * rest) / np.sum(slope * slope)  # of half a pixel
        assert abs(steps) / 2 < 0.02  # pixels; halvings that forgot their half texel would be 0.2 to 0.35 off


@pytest.mark.parametrize("columns", [1, 7, 100])
def test_a_step_of_whole_pixels_shifts_the_picture_by_them(columns: int) -> None:
    texture, pixel_mm = Noise(seed=1, texel_mm=TEXEL_MM), 0.7
    u = np.arange(300) * pixel_mm
    here, there = row(texture, u, pixel_mm), row(texture, u + columns * pixel_mm, pixel_mm)
    # float32 texture coordinates, in steps of 1/32 texel where OpenCV interpolates in fixed point
    np.testing.assert_allclose(there[:-columns], here[columns:], atol=2.0)
    assert np.sqrt(np.mean((there[:-columns] - here[columns:]) ** 2)) < 0.5


def test_a_step_of_a_quarter_pixel_moves_it_by_that() -> None:
    texture, pixel_mm = Noise(seed=1, texel_mm=TEXEL_MM), 0.7
    u = np.arange(2000) * pixel_mm
    before, here, there, after = (row(texture, u + part * pixel_mm, pixel_mm) for part in (-0.125, 0.0, 0.25, 0.375))
    slope = (after - before) / 0.5  # grey levels per pixel, halfway between the two
    assert np.sum(slope * (there - here)) / np.sum(slope * slope) == pytest.approx(0.25, abs=0.01)


def test_the_seed_makes_the_noise() -> None:
    at = np.linspace(0, 200, 128)
    one, again, other = (patch(Noise(seed=seed, texel_mm=TEXEL_MM), 0.5, at).ravel() for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.2


def test_mean_and_contrast_are_those_asked_for() -> None:
    # the whole tile: noise has no mean of its own, but is clipped where sensors clip
    at = np.arange(0, 1024, 4) * TEXEL_MM
    grey = patch(Noise(seed=9, texel_mm=TEXEL_MM, mean=140.0, contrast=25.0), 0.01, at)
    assert grey.mean() == pytest.approx(140.0, abs=1.0)
    assert grey.std() == pytest.approx(25.0, rel=0.05)
    loud = patch(Noise(seed=9, texel_mm=TEXEL_MM, contrast=200.0), 0.01, at)
    assert (loud.min(), loud.max()) == (4, 251)


def test_a_plain_surface_has_one_grey() -> None:
    u = np.linspace(-5, 5, 7)
    np.testing.assert_array_equal(Plain(77.0).shade(u, u, np.ones(7)), 77.0)


def test_no_points_have_no_greys() -> None:
    none = np.zeros(0)
    for texture in (Plain(), Noise(seed=1, texel_mm=1.0), Checkered(9, 7, 10.0)):
        assert texture.shade(none, none, none).shape == (0,)


BOARD = Checkered(columns=9, rows=7, square_mm=10.0, black=20.0, white=220.0)


def look(u_mm: float, v_mm: float, pixel_mm: float = 0.01) -> float:
    return round(float(BOARD.shade(np.array([u_mm]), np.array([v_mm]), np.array([pixel_mm]))[0]), 6)


def test_squares_alternate_around_every_inner_corner() -> None:
    for i in range(9):
        for j in range(7):
            around = [look(10 * i + du, 10 * j + dv) for du, dv in ((-1, -1), (1, -1), (-1, 1), (1, 1))]
            assert around[0] == around[3] != around[1] == around[2]
            assert {around[0], around[1]} == {20.0, 220.0}


def test_the_board_has_one_square_more_than_corners_each_way_and_white_beyond() -> None:
    assert look(-9.9, -9.9) == look(5, 5) == 220.0
    assert look(-9.9, 5) == 20.0
    assert look(-10.1, 5) == look(90.1, -5) == look(5, -10.1) == look(-5, 70.1) == 220.0
    assert look(89.9, 5) == look(5, 69.9) == 220.0
    assert look(89.9, -5) == look(-5, 69.9) == 20.0


def test_a_pixel_on_an_edge_is_as_grey_as_its_parts() -> None:
    assert look(10.0, 5.0, pixel_mm=1.0) == pytest.approx(120.0)
    assert look(10.25, 5.0, pixel_mm=1.0) == pytest.approx(20 + 200 * 0.25)  # a quarter of it still sees white
    assert look(10.0, 10.0, pixel_mm=1.0) == pytest.approx(120.0)


def test_from_far_away_the_squares_are_one_grey() -> None:
    assert look(33.0, 21.0, pixel_mm=20.0) == pytest.approx(120.0)
