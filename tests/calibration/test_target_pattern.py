"""The ink of a board: what OpenCV and Kalibr mean by it, to the pixel."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.target.ink import Ink
from prismstereo_calibration.target.pattern import board_frame, board_ink, raster, tag_number
from prismstereo_hw.errors import UsageError

STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)


def refined(pixels: NDArray[np.uint8], near: NDArray[np.float64]) -> NDArray[np.float64]:
    """The saddles, behind a lens that is a little soft as lenses are."""
    start, soft = near.astype(np.float32).reshape(-1, 1, 2), cv2.GaussianBlur(pixels, (0, 0), 1.0)
    return np.reshape(cv2.cornerSubPix(soft, start, (5, 5), (-1, -1), STOP), (-1, 2)).astype(float)


def test_a_charuco_board_is_the_one_that_opencv_draws() -> None:
    board = Board.parse("charuco:7x5:5x5_100:0.7", 20.0)
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    theirs = np.squeeze(cv2.aruco.CharucoBoard((7, 5), 20, 14, book).generateImage((1400, 1000), marginSize=0))

    ours = raster(board, pixels_per_mm=10, margin=0).pixels

    assert ours.shape == theirs.shape
    assert np.mean(ours != theirs) == 0


@pytest.mark.parametrize("name", ["charuco:8x6", "charuco:8x6:inverted"])
def test_opencv_finds_every_corner_of_a_charuco_board_under_its_name(name: str) -> None:
    board = Board.parse(name, 20.0)
    drawn = raster(board, pixels_per_mm=3.7)  # edges fall between pixels
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    settings = cv2.aruco.DetectorParameters()
    settings.detectInvertedMarker = board.inverted
    detector = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard((8, 6), 20, 15, book), detectorParams=settings)

    corners, numbers, _, _ = detector.detectBoard(drawn.pixels)

    assert sorted(np.ravel(numbers)) == list(range(35))
    found = refined(drawn.pixels, np.reshape(corners, (-1, 2)))
    assert np.abs(found - drawn.pixel(board.points())[np.ravel(numbers)]).max() < 0.02


def test_an_april_grid_is_kalibrs_with_tag_0_in_the_lower_left_and_two_modules_of_border() -> None:
    board = Board.parse("aprilgrid:4x3", 30.0)
    drawn = raster(board, pixels_per_mm=5.3)
    places = board.points()[:, :2].reshape(3, 2, 4, 2, 2)  # tag row, corner row, tag column, corner column
    origin = places[2, 0, 0, 0]
    module = np.arange(10) * 3.0 + 1.5
    centres = origin + np.stack(np.meshgrid(module, module), axis=-1)
    x, y = np.rint(drawn.pixel(centres)).astype(int).T

    bits = drawn.pixels[y.T, x.T] > 127

    assert tag_number(board, 0, 2) == 0
    assert not np.concatenate([bits[:2].ravel(), bits[-2:].ravel(), bits[:, :2].ravel(), bits[:, -2:].ravel()]).any()
    assert int("".join(str(int(bit)) for bit in bits[2:8, 2:8].ravel()), 2) == 0xD5D628584  # Kalibr's t36h11[0]


def test_opencv_finds_the_tags_of_an_april_grid_where_the_board_says() -> None:
    board = Board.parse("aprilgrid:4x3", 30.0)
    drawn = raster(board, pixels_per_mm=5.3)
    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = 2
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)

    corners, numbers, _ = cv2.aruco.ArucoDetector(book, settings).detectMarkers(drawn.pixels)

    truth = drawn.pixel(board.points()).reshape(3, 2, 4, 2, 2)
    centres = {tag_number(board, column, row): truth[row, :, column].reshape(4, 2).mean(axis=0)
               for row in range(3) for column in range(4)}  # fmt: skip
    found = {int(n): np.reshape(c, (4, 2)).mean(axis=0) for n, c in zip(np.ravel(numbers), corners, strict=True)}
    assert sorted(found) == list(range(12))
    assert max(np.abs(found[number] - centre).max() for number, centre in centres.items()) < 1
    # cornerSubPix itself errs by 0.04 px (0.007 mm) where all windows lie alike between the pixels
    assert np.abs(refined(drawn.pixels, truth.reshape(-1, 2)) - truth.reshape(-1, 2)).max() < 0.05


@pytest.mark.parametrize("name", ["chessboard:6x4", "charuco:5x4", "aprilgrid:3x2"])
def test_an_inverted_board_is_the_negative(name: str) -> None:
    plain, inverted = (raster(Board.parse(name + end, 10.0), 3.0).pixels.astype(int) for end in ("", ":inverted"))

    np.testing.assert_allclose(plain + inverted, 255, atol=1)  # both round half a level


def test_ink_does_not_overlap_and_a_coarse_raster_keeps_its_area() -> None:
    board = Board(6, 4, 10.0)
    ink, frame = board_ink(board), board_frame(board, margin=1.0)
    sides = ink.rectangles[:, 2:] - ink.rectangles[:, :2]
    assert sides.prod(axis=1).sum() == pytest.approx(18 * 100)  # 18 black squares of 7 x 5

    grey = ink.raster(frame, 0.37).pixels  # 3.7 pixels to a square

    assert (255 - grey.astype(float)).sum() / 255 / 0.37**2 == pytest.approx(18 * 100, rel=2e-3)


def test_overlapping_rectangles_become_one_ink() -> None:
    ink = Ink.of(np.array([[0, 0, 2, 1], [1, 0, 3, 1], [0, 1, 3, 2], [5, 5, 6, 6.0]]))

    np.testing.assert_array_equal(ink.rectangles, [[0, 0, 3, 2], [5, 5, 6, 6]])


@pytest.mark.parametrize("name", ["charuco:11x10:4x4_50", "aprilgrid:6x6:16h5", "charuco:6x4:4x5_50"])
def test_a_board_with_more_markers_than_there_are_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match=r"give fewer|give one like"):
        board_ink(Board.parse(name))
