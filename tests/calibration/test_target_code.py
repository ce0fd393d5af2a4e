"""The code beside a board: it says which board it is, with markers hidden, and never another."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from numpy.typing import NDArray

from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.target.code import code_dictionary, decode, encode, obstacle
from prismstereo_calibration.target.page import Page
from prismstereo_calibration.target.pattern import module_share, raster
from prismstereo_calibration.target.reading import read, read_from
from prismstereo_calibration.target.sheet import Sheet, lay_out
from prismstereo_hw.errors import UsageError
from prismstereo_hw.view import View, layout

PX_PER_MM = 2.0
BOOKS = ["4x4_50", "4x4_1000", "5x5_100", "6x6_250", "7x7_1000", "16h5", "36h11"]

sides = some.integers(4, 64)
tenths = some.integers(10, 9999).map(lambda tenths: tenths / 10)
shares = some.integers(5, 95).map(lambda percent: percent / 100)
chessboards = some.builds(Board, sides, sides, tenths, inverted=some.booleans())
marked = some.builds(
    Board, sides, sides, tenths, some.sampled_from(["charuco", "aprilgrid"]), shares, some.sampled_from(BOOKS),
    some.booleans(),
)  # fmt: skip
boards = chessboards | marked
shuffled = some.permutations(range(10))


@cache
def drawn(name: str) -> tuple[Sheet, NDArray[np.uint8]]:
    sheet = lay_out(Board.parse(name), Page.parse("a4"))
    frame = (0.0, 0.0, sheet.page.width_mm, sheet.page.height_mm)
    return sheet, sheet.ink.raster(frame, PX_PER_MM).pixels


def hidden(name: str, *places: int) -> NDArray[np.uint8]:
    """The sheet with thumbs on some markers of its code."""
    sheet, pixels = drawn(name)
    assert sheet.code is not None
    covered, (x0, y0, x1, _) = pixels.copy(), sheet.code.bounds
    module = module_share(sheet.board) * sheet.board.square
    pitch = 8 * module  # 5x5 markers with their border, and the paper between
    per_row = round((x1 - x0 + module) / pitch)
    for place in places:
        row, column = divmod(place, per_row)
        x, y = (PX_PER_MM * np.array([x0 + column * pitch, y0 + row * pitch])).astype(int)
        covered[y : y + int(PX_PER_MM * pitch), x : x + int(PX_PER_MM * pitch)] = 180
    return covered


@given(boards, shuffled, some.integers(8, 10))
def test_a_code_names_its_board_in_any_order_with_two_markers_hidden(board: Board, order: list[int], left: int) -> None:
    markers = [encode(board)[place] for place in order[:left]]

    assert decode(markers, code_dictionary(board)) == board


@given(boards, shuffled, some.integers(8, 10), some.lists(some.integers(1, 96), min_size=1, max_size=2))
def test_a_wrong_checksum_is_refused(board: Board, order: list[int], left: int, errors: list[int]) -> None:
    markers = [encode(board)[place] for place in order[:left]]
    for index, error in enumerate(errors):
        place, digit = divmod(markers[index], 100)
        markers[index] = 100 * place + (digit + error) % 97

    assert decode(markers, code_dictionary(board)) is None


@given(some.integers(0, 990), some.integers(1, 1000), some.sampled_from(["5x5_1000", "6x6_1000"]))
def test_the_markers_of_an_ordinary_board_are_no_code(first: int, count: int, dictionary: str) -> None:
    assert decode(range(first, min(first + count, 1000)), dictionary) is None


def test_a_code_is_of_other_markers_than_its_board() -> None:
    board = Board.parse("charuco:7x5:5x5_100", 20.0)
    assert (code_dictionary(Board(9, 6, 20.0)), code_dictionary(board)) == ("5x5_1000", "6x6_1000")
    assert decode(encode(board), "5x5_1000") is None


@pytest.mark.parametrize(
    ("name", "square_mm", "why"),
    [
        ("chessboard:9x6", None, "nobody said"),
        ("chessboard:9x6", 12.34, "steps of 0.1 mm"),
        ("chessboard:9x6", 1000.0, "1 to 999.9 mm"),
        ("charuco:9x6:0.123", 12.0, "steps of 0.01"),
    ],
)
def test_a_board_that_the_code_cannot_say_has_none(name: str, square_mm: float | None, why: str) -> None:
    board = Board.parse(name, square_mm)
    assert why in obstacle(board)
    with pytest.raises(UsageError, match="has no code"):
        encode(board)


@pytest.mark.parametrize(
    "name", ["charuco:11x8", "charuco:8x6:inverted", "chessboard:9x6", "aprilgrid:6x5", "charuco:8x5:5x5_50"]
)
def test_the_printed_code_is_read_from_a_picture(name: str) -> None:
    sheet, pixels = drawn(name)
    colour = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)

    assert sheet.board.square_mm is not None
    assert read(colour) == sheet.board


def test_a_slanted_small_and_soft_picture_is_read() -> None:
    sheet, pixels = drawn("charuco:11x8")
    high, wide = pixels.shape
    to = np.array([[20, 30], [300, 10], [310, 220], [10, 205]], np.float32)  # half a pixel to a millimetre
    corners = np.array([[0, 0], [wide, 0], [wide, high], [0, high]], np.float32)
    fine = cv2.warpPerspective(pixels, cv2.getPerspectiveTransform(corners, 4 * to), (1280, 960), borderValue=60)

    assert read(cv2.resize(fine, (320, 240), interpolation=cv2.INTER_AREA).astype(np.uint8)) == sheet.board


def test_two_markers_may_be_hidden_and_three_may_not() -> None:
    name = "charuco:11x8"
    assert read(hidden(name, 4)) == drawn(name)[0].board
    assert read(hidden(name, 0, 7)) == drawn(name)[0].board
    assert read(hidden(name, 0, 3, 7)) is None


def test_frames_that_each_show_a_part_are_read_together_through_mirrored_views() -> None:
    name = "charuco:11x8"
    mirror = View(left=0.5, top=0.0, width=0.5, height=1.0, mirrored=True)
    first, second = hidden(name, 0, 3, 7), hidden(name, 1, 2, 9)
    blank = np.full_like(first, 128)
    frames = [
        NamedFrame("a.png", np.concatenate([first, blank], axis=1)),
        NamedFrame("b.png", np.concatenate([blank, second[:, ::-1]], axis=1)),
    ]

    assert read_from(frames, (layout("side-by-side")[0], mirror)) == drawn(name)[0].board


def test_frames_without_a_code_are_an_error_that_says_what_to_do() -> None:
    pixels = raster(Board.parse("charuco:8x6", 20.0), 2.0).pixels

    assert read(pixels) is None
    with pytest.raises(CalibrationError, match=r"no board code in 1 frames \(0 of its markers seen.*--board"):
        read_from([NamedFrame("a.png", np.tile(pixels, (1, 2)))], layout("side-by-side"))
