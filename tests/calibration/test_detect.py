"""Detection: corners to a few hundredths of a pixel, one order in both views, and one clear sentence where it fails."""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.drawn_boards import DrawnBoards, drawn_boards
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.chessboard import agree
from prismstereo_calibration.boards.corners import Refusal
from prismstereo_calibration.boards.detect import detect, find_corners
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.rig import Rig
from prismstereo_hw.view import View, layout


@cache
def boards() -> DrawnBoards:
    return drawn_boards(Rig.read("oak-1"), 3)


def sheet(columns: int, rows: int, square_px: int = 30) -> NDArray[np.uint8]:
    """A board of so many INNER corners, facing, with a white margin; corner (0, 0) between the first four squares."""
    y, x = np.mgrid[0 : (rows + 1) * square_px, 0 : (columns + 1) * square_px]
    squares = np.where((x // square_px + y // square_px) % 2 == 0, 30, 220).astype(np.uint8)
    return np.pad(squares, square_px, constant_values=220)


def side_by_side(
    left: NDArray[np.uint8], right: NDArray[np.uint8], shape: tuple[int, int] = (480, 640)
) -> NDArray[np.uint8]:
    """Both pictures in the middle of grey halves of that shape."""
    halves = []
    for picture in (left, right):
        half = np.full(shape, 110, np.uint8)
        y, x = (shape[0] - picture.shape[0]) // 2, (shape[1] - picture.shape[1]) // 2
        half[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
        halves.append(half)
    return np.hstack(halves)


def test_corners_of_rendered_boards_are_found_to_a_tenth_of_a_pixel() -> None:
    drawn = boards()
    detection = detect(drawn.frames, drawn.rig.views, drawn.board)
    assert [pair.name for pair in detection.sightings] == ["view00.png", "view01.png", "view02.png"]
    off = detection.pixels() - drawn.truth_px
    assert np.sqrt(np.mean(off**2)) < 0.07  # measured 0.05
    assert np.abs(off).max() < 0.25
    assert np.abs(off.mean(axis=(0, 2))).max() < 0.02  # no bias of half pixels


def test_pixels_are_upright_whatever_the_attitude_of_a_view() -> None:
    drawn = boards()
    frame, (left, right) = drawn.frames[0].pixels, drawn.rig.views
    flipped = frame.copy()
    flipped[:, 640:] = frame[:, 640:][:, ::-1]
    mirrored_left = View(left=left.left, top=left.top, width=left.width, height=left.height, mirrored=True)
    plain = detect([NamedFrame("a", frame)], (left, right), drawn.board)
    mirrored = detect([NamedFrame("a", flipped)], (mirrored_left, right), drawn.board)
    np.testing.assert_array_equal(mirrored.pixels(), plain.pixels())


def test_a_turned_view_gives_the_pixels_of_the_upright_one() -> None:
    drawn = boards()
    frame, (left, right) = drawn.frames[0].pixels, drawn.rig.views
    upside_down = frame.copy()
    upside_down[:, 640:] = frame[::-1, 640:][:, ::-1]
    turned_left = View(left=left.left, top=left.top, width=left.width, height=left.height, turn_deg=180)
    plain = detect([NamedFrame("a", frame)], (left, right), drawn.board)
    turned = detect([NamedFrame("a", upside_down)], (turned_left, right), drawn.board)
    np.testing.assert_array_equal(turned.pixels(), plain.pixels())


@pytest.mark.parametrize("board", [Board(9, 7), Board(7, 7), Board(8, 6)])
@pytest.mark.parametrize("spin_deg", [0, 37, 85, 95, 140, 180, 270])
def test_both_views_count_the_corners_alike_however_the_board_is_held(board: Board, spin_deg: int) -> None:
    picture = sheet(board.columns, board.rows, 20)
    height, width = picture.shape
    pictures = []
    for spin in (spin_deg - 4, spin_deg + 4):  # the two views of a rig see the board turned a little differently
        M = cv2.getRotationMatrix2D((width / 2, height / 2), spin, 1.0)
        M[:, 2] += 200 - np.array([width / 2, height / 2])
        pictures.append(cv2.warpAffine(picture, M, (400, 400), borderValue=220).astype(np.uint8))
    detection = detect([NamedFrame("a", side_by_side(*pictures))], layout("side-by-side"), board)
    left, right = detection.pixels()[0]
    last = board.columns - 1
    direction = [math.degrees(math.atan2(*(pixels[last] - pixels[0])[::-1])) for pixels in (left, right)]
    assert abs((direction[0] - direction[1] + 180) % 360 - 180) == pytest.approx(8.0, abs=0.5)
    rows = left.reshape(board.rows, board.columns, 2)
    x, y = rows[0, -1] - rows[0, 0], rows[-1, 0] - rows[0, 0]
    assert x[0] * y[1] - x[1] * y[0] > 0  # right-handed


def test_agreement_undoes_a_half_turn_of_the_corner_order() -> None:
    board = Board(9, 7)
    corners = board.points()[:, :2] * 20 + 100
    seen = corners + np.array([300.0, 4.0])
    np.testing.assert_array_equal(agree(corners, seen[::-1], board), seen)


@pytest.mark.parametrize("asked", [(8, 6), (8, 7), (9, 6), (7, 7), (5, 5)])
def test_a_part_of_a_larger_board_is_no_board(asked: tuple[int, int]) -> None:
    picture = boards().rig.views[0].cut(boards().frames[0].pixels)
    assert isinstance(find_corners(picture, Board(*asked)), Refusal)


def test_a_board_of_another_size_is_named_with_the_flag_to_pass() -> None:
    drawn = boards()
    with pytest.raises(
        CalibrationError, match=r"no 9x6 board .* found a 9x7 board in view00\.png: pass --board chessboard:9x7"
    ):
        detect(drawn.frames[:1], drawn.rig.views, Board(9, 6))


def test_frames_without_a_board_end_in_one_sentence() -> None:
    noise = np.random.default_rng(3).integers(0, 255, (240, 640), dtype=np.uint8)
    with pytest.raises(CalibrationError, match=r"no 9x6 board in any of 2 frames: count the inner corners"):
        detect([NamedFrame("a.png", noise), NamedFrame("b.png", noise // 2)], layout("side-by-side"), Board(9, 6))


def test_no_frames_at_all_are_refused() -> None:
    with pytest.raises(CalibrationError, match="there is no frame"):
        detect([], layout("side-by-side"), Board(9, 6))


def test_a_board_that_only_one_view_ever_sees_is_said_to_be_so() -> None:
    frame = side_by_side(sheet(9, 6), np.full((60, 60), 200, np.uint8))
    with pytest.raises(CalibrationError, match="seen in the left view of 2 frames, but never in the right view"):
        detect([NamedFrame("a.png", frame), NamedFrame("b.png", frame)], layout("side-by-side"), Board(9, 6))
    with pytest.raises(CalibrationError, match="seen in the right view of 1 frames, but never in the left view"):
        detect([NamedFrame("a.png", frame)], layout("swapped"), Board(9, 6))


def test_a_board_that_is_never_in_both_views_at_once_is_said_to_be_so() -> None:
    empty = np.full((60, 60), 200, np.uint8)
    frames = [
        NamedFrame("a.png", side_by_side(sheet(9, 6), empty)),
        NamedFrame("b.png", side_by_side(empty, sheet(9, 6))),
    ]
    with pytest.raises(CalibrationError, match="never in both views of one frame"):
        detect(frames, layout("side-by-side"), Board(9, 6))


def test_frames_without_the_board_are_listed_with_the_view_that_lacks_it() -> None:
    board, empty = sheet(9, 6), np.full((60, 60), 200, np.uint8)
    frames = [
        NamedFrame("both.png", side_by_side(board, board)),
        NamedFrame("left.png", side_by_side(board, empty)),
        NamedFrame("right.png", side_by_side(empty, board)),
        NamedFrame("none.png", side_by_side(empty, empty)),
    ]
    seen: list[tuple[int, int, str]] = []
    detection = detect(frames, layout("side-by-side"), Board(9, 6), lambda *told: seen.append(told))
    assert [pair.name for pair in detection.sightings] == ["both.png"]
    assert {entry.name: entry.reason for entry in detection.rejected} == {
        "left.png": "no board in the right view",
        "right.png": "no board in the left view",
        "none.png": "no board in either view",
    }
    assert seen[0] == (1, 4, "both.png")
    assert [done for done, _, _ in seen] == [1, 2, 3, 4]


def test_frames_of_two_sizes_are_refused_with_both_names_and_sizes() -> None:
    frame = side_by_side(sheet(9, 6), sheet(9, 6))
    frames = [NamedFrame("a.png", frame), NamedFrame("b.png", frame[:-2])]
    with pytest.raises(CalibrationError, match=r"b\.png is 1280x478, but a\.png is 1280x480"):
        detect(frames, layout("side-by-side"), Board(9, 6))


@pytest.mark.parametrize("pixels", [np.zeros((8, 16), np.uint8), np.full((480, 1280, 3), 255, np.uint8)])
def test_empty_and_tiny_pictures_are_refused_without_a_stumble(pixels: NDArray[np.uint8]) -> None:
    with pytest.raises(CalibrationError, match="no 9x6 board"):
        detect([NamedFrame("a.png", pixels)], layout("side-by-side"), Board(9, 6))
