"""The seam is found in the picture: as a step or as a band, wherever it is, and not where there is none."""

from __future__ import annotations

import math
from functools import cache

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_calibration.seam import OWN_LIGHT, find_seam
from prismstereo_hw.errors import ImageError
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.twin import Twin

HEIGHT, WIDTH = 360, 640
MIDDLE = (WIDTH - 1) / 2


def texture(seed: int, grain_px: float) -> NDArray[np.float64]:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((HEIGHT, WIDTH)), (0, 0), grain_px)
    return np.asarray(120 + 35 * noise / noise.std())


@cache
def meeting(
    column: float,
    slant_deg: float = 0.0,
    band_px: float = 0.0,
    seed: int = 1,
    grain_px: float = 1.0,
    light: float = 1.0,
) -> NDArray[np.uint8]:
    """Two unrelated pictures that meet in a step, or mix over a band as behind a round pupil."""
    left, right = texture(2 * seed, grain_px), light * texture(2 * seed + 1, grain_px)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    beyond = columns - column - (rows - (HEIGHT - 1) / 2) * math.tan(math.radians(slant_deg))
    u = np.clip(2 * beyond / band_px, -1, 1) if band_px else np.sign(beyond)
    share = 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / math.pi
    noise = np.random.default_rng(seed).standard_normal((HEIGHT, WIDTH))
    return np.clip(np.rint(share * right + (1 - share) * left + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("column", [MIDDLE, MIDDLE + 10, MIDDLE - 40])
@pytest.mark.parametrize("grain_px", [0.8, 3.0])
def test_a_step_is_found_to_a_fraction_of_a_pixel(column: float, grain_px: float) -> None:
    seam = find_seam([meeting(column, grain_px=grain_px)])

    assert seam.column_px == pytest.approx(column, abs=0.3)
    assert seam.slant_deg == pytest.approx(0, abs=0.11)
    assert seam.width_px == 0
    assert seam.clearness > 1


@pytest.mark.parametrize("slant_deg", [-1.5, 0.7])
def test_a_slanted_step_is_found_with_its_slant(slant_deg: float) -> None:
    seam = find_seam([meeting(MIDDLE + 8, slant_deg)])

    assert seam.column_px == pytest.approx(MIDDLE + 8, abs=0.5)
    assert seam.slant_deg == pytest.approx(slant_deg, abs=0.15)
    lean = math.tan(math.radians(slant_deg))
    assert seam.column_at(0, HEIGHT) == pytest.approx(MIDDLE + 8 - lean * (HEIGHT - 1) / 2, abs=1.0)


@pytest.mark.parametrize("column", [MIDDLE, MIDDLE + 12])
@pytest.mark.parametrize("band_px", [40.0, 80.0, 110.0])
def test_a_blended_band_is_found_with_its_width(column: float, band_px: float) -> None:
    seam = find_seam([meeting(column, band_px=band_px)])

    assert seam.column_px == pytest.approx(column, abs=3)
    assert seam.width_px == pytest.approx(0.687 * band_px, rel=0.2)  # what of a round pupil is cut by less than a tenth
    assert math.isnan(seam.slant_deg)  # so wide a band does not tell


def test_a_narrow_band_tells_roughly_how_it_leans() -> None:
    seam = find_seam([meeting(MIDDLE, 1.2, 18.0, grain_px=0.8)])

    assert seam.width_px > 0
    assert seam.slant_deg == pytest.approx(1.2, abs=0.6)


def test_the_share_of_a_pupil_at_the_edge_of_the_width_is_nine_tenths() -> None:
    u = 0.687
    assert 0.5 + (u * math.sqrt(1 - u * u) + math.asin(u)) / math.pi == pytest.approx(OWN_LIGHT, abs=1e-3)


def test_a_view_that_is_darker_or_blurred_leaves_the_seam_where_it_is() -> None:
    blurred = meeting(MIDDLE).copy()
    blurred[:, WIDTH // 2 :] = cv2.GaussianBlur(blurred[:, WIDTH // 2 :], (0, 0), 2.0)

    assert find_seam([blurred]).column_px == pytest.approx(MIDDLE, abs=1)
    assert find_seam([meeting(MIDDLE, light=0.6)]).column_px == pytest.approx(MIDDLE, abs=1)
    assert find_seam([meeting(MIDDLE, band_px=80, light=0.6)]).column_px == pytest.approx(MIDDLE, abs=8)


def test_a_stark_upright_edge_over_half_of_the_height_is_no_seam() -> None:
    picture = meeting(MIDDLE).copy()
    picture[90:270, 350:356] = 255

    assert find_seam([picture]).column_px == pytest.approx(MIDDLE, abs=0.3)


def test_more_frames_show_what_one_hides() -> None:
    blended = [meeting(MIDDLE + 6, band_px=60, seed=seed, grain_px=3.0) for seed in (3, 4, 5, 6)]

    assert find_seam(blended).column_px == pytest.approx(MIDDLE + 6, abs=3)
    assert find_seam(blended).clearness > max(1.0, min(clearness(frame) for frame in blended))


def clearness(frame: NDArray[np.uint8]) -> float:
    try:
        return find_seam([frame]).clearness
    except ImageError:
        return 0.0


@pytest.mark.parametrize("aside_px", [0.0, 10.2])
def test_a_twin_whose_lens_is_off_its_axis_has_its_seam_there(small: Rig, aside_px: float) -> None:
    video = msgspec.structs.replace(small.camera.video, width=WIDTH, height=HEIGHT)
    camera = msgspec.structs.replace(small.camera, video=video, principal_offset_px=(aside_px, 0.0))
    rig = msgspec.structs.replace(small, camera=camera)

    seam = find_seam([Twin(rig, facing_plane(rig, 800.0)).frame().pixels])

    assert seam.column_px == pytest.approx(MIDDLE + aside_px, abs=1)


class TestWhatShowsNoSeam:
    def test_a_blank_wall(self) -> None:
        wall = np.clip(120 + np.random.default_rng(1).standard_normal((HEIGHT, WIDTH)), 0, 255).astype(np.uint8)
        with pytest.raises(ImageError, match="blank scene"):
            find_seam([wall])

    def test_one_picture_without_a_prism(self) -> None:
        with pytest.raises(ImageError, match="no seam within 96 columns of column 320"):
            find_seam([np.clip(np.rint(texture(1, 1.0)), 0, 255).astype(np.uint8)])

    def test_no_frame_and_frames_of_several_sizes(self) -> None:
        with pytest.raises(ImageError, match="0 frames"):
            find_seam([])
        with pytest.raises(ImageError, match="2 sizes"):
            find_seam([meeting(MIDDLE), meeting(MIDDLE)[:-2]])

    def test_a_picture_too_small_to_tell(self) -> None:
        with pytest.raises(ImageError, match="at least 64x48"):
            find_seam([np.zeros((40, 40), np.uint8)])
