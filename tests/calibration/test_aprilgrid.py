"""AprilGrids, as Kalibr prints them and as others do: four named corners to a tag."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibration.photographed_boards import Photograph
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.corners import Refusal, find_corners
from prismstereo_calibration.boards.marker_corners import MIRRORED
from prismstereo_calibration.target.ink import Raster

GRID = Board.parse("aprilgrid:6x4")
TAG_PX, GAP_PX, FIRST_PX = 80, 24, 60


def one_module_print(turns: int) -> Raster:
    """The grid with OpenCV's tags, one module of border, turned by so many quarters; tag 0 at the lower left."""
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    pitch = TAG_PX + GAP_PX
    sheet = np.full((FIRST_PX * 2 + 4 * pitch, FIRST_PX * 2 + 6 * pitch), 255, np.uint8)
    for row in range(4):
        for column in range(6):
            x, y = FIRST_PX + column * pitch, FIRST_PX + row * pitch
            for dx in (-GAP_PX, TAG_PX):
                for dy in (-GAP_PX, TAG_PX):
                    sheet[y + dy : y + dy + GAP_PX, x + dx : x + dx + GAP_PX] = 0
            tag = np.asarray(book.generateImageMarker(6 * (3 - row) + column, TAG_PX, borderBits=1), np.uint8)
            sheet[y : y + TAG_PX, x : x + TAG_PX] = np.rot90(tag, turns)
    return Raster(sheet, np.array([[TAG_PX, 0, FIRST_PX - 0.5], [0, TAG_PX, FIRST_PX - 0.5], [0, 0, 1.0]]))


def test_all_corners_of_a_kalibr_grid_are_found_to_a_few_hundredths_of_a_pixel() -> None:
    random = np.random.default_rng(4)
    off = []
    for seed in range(4):
        tilt, axis, spin = random.uniform([0, 0, 0], [40, 360, 360])
        photograph = Photograph(GRID, random.uniform(34, 44), tilt, axis, spin, seed=seed)
        found = find_corners(photograph.pixels, GRID)
        assert not isinstance(found, Refusal), found
        off.append(np.linalg.norm(found - photograph.truth_px, axis=1))
    assert np.isfinite(np.concatenate(off)).mean() > 0.97
    assert np.nanmedian(np.concatenate(off)) < 0.03  # measured 0.01
    assert np.nanmax(np.concatenate(off)) < 0.12


@pytest.mark.parametrize("turns", [0, 2])
def test_tags_with_one_module_of_border_are_found_whichever_way_up_they_were_printed(turns: int) -> None:
    photograph = Photograph(GRID, 40, 20, spin_deg=10, print=one_module_print(turns))
    found = find_corners(photograph.pixels, GRID)
    assert not isinstance(found, Refusal), found
    off = np.linalg.norm(found - photograph.truth_px, axis=1)
    assert np.isfinite(off).mean() > 0.97
    assert np.nanmax(off) < 0.2


def test_a_part_of_a_grid_keeps_its_names() -> None:
    photograph = Photograph(GRID, 60, 20, spin_deg=-20, middle_px=(240, 60))
    found = find_corners(photograph.pixels, GRID)
    assert not isinstance(found, Refusal), found
    off = np.linalg.norm(found - photograph.truth_px, axis=1)
    assert 16 <= np.isfinite(off).sum() < 80
    assert np.nanmax(off) < 0.15


def test_a_mirrored_grid_and_one_with_other_columns_are_told_apart() -> None:
    pixels = Photograph(GRID, 44).pixels
    assert find_corners(pixels[:, ::-1], GRID) == MIRRORED
    wrong = find_corners(pixels, Board.parse("aprilgrid:5x5"))
    assert isinstance(wrong, Refusal)
    assert "counts are wrong" in wrong.reason
