"""Views that show the board too badly to measure by: refused, each for its own reason and with the figure that says so."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.photographed_boards import Photograph
from prismstereo_calibration.boards.board import Board
from prismstereo_calibration.boards.corners import Found, Refusal, find_corners, look
from prismstereo_calibration.boards.detect import detect
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.seam import Seam
from prismstereo_hw.view import View, layout

CHESS, CHARUCO, GRID = Board(9, 7), Board.parse("charuco:11x8"), Board.parse("aprilgrid:6x4")
HALVES = layout("side-by-side")
Grey = NDArray[np.uint8]


@cache
def picture(board: Board, square_px: float = 32, x: float = 0.0, blur_px: float = 0.6) -> Grey:
    return Photograph(board, square_px, 20, middle_px=(x, 0), blur_px=blur_px).pixels


def pair(name: str, left: Grey, right: Grey) -> NamedFrame:
    return NamedFrame(name, np.hstack([left, right]))


def reason(photograph: Photograph) -> str:
    found = find_corners(photograph.pixels, photograph.board)
    assert isinstance(found, Refusal)
    return found.reason


@pytest.mark.parametrize("board", [CHESS, CHARUCO, GRID])
@pytest.mark.parametrize("blur_px", [0.8, 1.4])
def test_the_width_of_the_edges_tells_the_blur(board: Board, blur_px: float) -> None:
    """An edge blurred by s (and by the pixels themselves, and by half a pixel of interpolation) is 2.5 s wide."""
    found = look(Photograph(board, 40, 20, axis_deg=30, blur_px=blur_px, noise=1).pixels, board)
    assert isinstance(found, Found)
    assert found.edge_px == pytest.approx(2.5 * np.hypot(blur_px, 0.5), rel=0.12)


@pytest.mark.parametrize(("board", "square_px"), [(CHESS, 24), (CHARUCO, 50)])
def test_a_blurred_board_is_refused_with_the_width_of_its_edges(board: Board, square_px: float) -> None:
    said = re.fullmatch(
        r"the board is blurred \(edges (.*) px wide, limit (.*)\)",
        reason(Photograph(board, square_px, 10, size=(640, 480), blur_px=3.4)),
    )
    assert said is not None
    assert float(said[1]) > 7.0
    assert float(said[2]) == 7.0


def test_a_streak_in_one_direction_counts_as_blur() -> None:
    sharp = Photograph(CHESS, 30, 10)
    streak = cv2.filter2D(sharp.pixels, -1, np.full((1, 11), 1 / 11))
    found = find_corners(np.asarray(streak, np.uint8), CHESS)
    assert isinstance(found, Refusal)
    assert "blurred" in found.reason


def test_a_frame_far_more_blurred_than_the_others_is_put_aside() -> None:
    frames = [pair(f"{x}", picture(CHARUCO, 32, 2.0 * x), picture(CHARUCO, 32, 2.0 * x - 10)) for x in range(5)]
    frames.insert(2, pair("moved", picture(CHARUCO), picture(CHARUCO, blur_px=2.2)))
    detection = detect(frames, HALVES, CHARUCO)
    assert [sighting.name for sighting in detection.sightings] == ["0", "1", "2", "3", "4"]
    assert [entry.name for entry in detection.rejected] == ["moved"]
    assert re.fullmatch(
        r"the board is blurred \(edges [45]\.\d px wide, 1\.\d px in the other frames\) in the right view",
        detection.rejected[0].reason,
    )


def test_a_board_seen_from_the_side_is_refused_with_its_angle() -> None:
    assert isinstance(look(Photograph(CHARUCO, 46, 60, size=(900, 600)).pixels, CHARUCO), Found)
    said = re.fullmatch(
        r"the board is seen too much from the side \((\d+) degrees, limit 70\)",
        reason(Photograph(CHARUCO, 46, 74, blur_px=0.4, size=(900, 600))),
    )
    assert said is not None
    assert int(said[1]) == pytest.approx(74, abs=3)


def test_rows_left_out_of_a_view_are_no_tilt() -> None:
    """Every third row of a tilted board: it looks 75 degrees tilted, and 40 once the rows are counted."""
    pixels = Photograph(CHARUCO, 60, 40, axis_deg=0, size=(800, 700)).pixels
    thinned = np.ascontiguousarray(pixels[::3])
    assert isinstance(look(thinned, CHARUCO), Refusal)
    found = look(thinned, CHARUCO, (1.0, 3.0))
    assert isinstance(found, Found)


def test_a_board_without_light_or_without_contrast_is_refused_with_its_greys() -> None:
    assert reason(Photograph(CHARUCO, 40, dark=8, bright=21, noise=0.3)) == (
        "the board is too dark (its squares are 8 and 21 of 255, 15 apart are the least)"
    )
    assert "too bright" in reason(Photograph(CHARUCO, 40, dark=240, bright=252, noise=0.3))


def test_a_board_with_tiny_squares_is_refused_or_not_found() -> None:
    found = find_corners(Photograph(CHESS, 3.5, blur_px=0).pixels, CHESS)
    assert isinstance(found, Refusal)


def test_corners_in_the_seam_are_left_out() -> None:
    """The right view's first columns are blended: marker boards lose those corners, a chessboard the frame."""
    seam = Seam(639.5 + 60, 0.0, 120.0, 2.0)
    left, right = picture(CHARUCO), picture(CHARUCO, x=-145)
    whole = detect([pair("a", left, right)], HALVES, CHARUCO).sightings[0]
    cut = detect([pair("a", left, right)], HALVES, CHARUCO, seam=seam).sightings[0]
    np.testing.assert_array_equal(cut.left, whole.left)
    blended = whole.right[:, 0] < 639.5 + 120 + 4
    assert 8 <= blended.sum() < len(blended) - 6
    assert np.isnan(cut.right[blended]).all()
    np.testing.assert_array_equal(cut.right[~blended], whole.right[~blended])
    frames = [pair("b", picture(CHESS), picture(CHESS)), pair("a", picture(CHESS), picture(CHESS, x=-150))]
    rejected = detect(frames, HALVES, CHESS, seam=seam).rejected
    assert [(entry.name, entry.reason) for entry in rejected] == [
        ("a", "the board lies over the seam in the right view")
    ]


def test_a_rig_of_three_views_needs_the_first_and_one_other() -> None:
    thirds = tuple(View(left=k / 3, top=0.0, width=1 / 3, height=1.0) for k in range(3))
    board, empty = picture(CHARUCO), np.full((480, 640), 90, np.uint8)
    frames = [
        NamedFrame("all", np.hstack([board, board, board])),
        NamedFrame("two", np.hstack([board, empty, board])),
        NamedFrame("last", np.hstack([empty, board, board])),
        NamedFrame("one", np.hstack([board, empty, empty])),
    ]
    detection = detect(frames, thirds, CHARUCO)
    assert [sighting.name for sighting in detection.sightings] == ["all", "two"]
    assert detection.pixels().shape == (2, 3, 70, 2)
    assert np.isnan(detection.sightings[1].pixels[1]).all()
    assert np.isfinite(detection.sightings[1].pixels[2]).all()
    assert {entry.name: entry.reason for entry in detection.rejected} == {
        "last": "no board in the left view",
        "one": "no board in the right view, no board in view 3",
    }


def test_a_single_view_is_refused() -> None:
    with pytest.raises(CalibrationError, match="1 view: a calibration is between two or more"):
        detect([NamedFrame("a", picture(CHESS))], HALVES[:1], CHESS)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("charuco:11x8:5x5_100", r"found \d+ markers of 4x4_50 in a\.png: pass --board charuco:11x8$"),
        ("charuco:11x8:inverted", r"found \d+ markers of 4x4_50 in a\.png: pass --board charuco:11x8$"),
        ("charuco:8x11", r"markers that do not lie as on charuco:8x11: its counts are wrong in the left view"),
        ("aprilgrid:6x4", r"found \d+ markers of 4x4_50 in a\.png"),
        ("chessboard:9x6", r"found \d+ markers of 4x4_50 in a\.png: it is no plain chessboard, pass --board charuco:"),
    ],
)
def test_a_wrong_board_is_answered_with_what_to_pass(asked: str, message: str) -> None:
    small = Photograph(CHARUCO, 22, 10, size=(320, 240)).pixels
    with pytest.raises(CalibrationError, match=rf"in any of 1 frames.*{message}"):
        detect([pair("a.png", small, small)], HALVES, Board.parse(asked))


def test_a_long_recording_of_another_board_is_stopped_after_six_frames() -> None:
    board = Photograph(Board(5, 4), 24, 10, size=(200, 160)).pixels
    frames = [pair(f"{number}", board, board) for number in range(60)]
    seen: list[int] = []
    with pytest.raises(
        CalibrationError, match=r"in any of the first 6 frames, but found a 5x4 board in 0: pass --board"
    ):
        detect(frames, HALVES, Board(5, 5), lambda done, _count, _name: seen.append(done))
    assert seen == [1, 2, 3, 4, 5, 6]


def test_views_that_are_mirrored_by_mistake_are_named() -> None:
    left, right = picture(CHARUCO), picture(CHARUCO)[:, ::-1]
    with pytest.raises(
        CalibrationError, match=r"never in the right view \(its markers are mirror images: the view's `mir"
    ):
        detect([pair("a", left, right)], HALVES, CHARUCO)


def test_a_stop_in_the_middle_goes_through() -> None:
    def stop(done: int, _count: int, _name: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    frames = [pair(name, picture(CHARUCO), picture(CHARUCO)) for name in "abc"]
    with pytest.raises(KeyboardInterrupt):
        detect(frames, HALVES, CHARUCO, stop)


FAULTS = ("blurred", "from the side", "counts are wrong", "mirror images", "too dark")


def spoilt(sound: Photograph, fault: str, random: np.random.Generator) -> tuple[Grey, Board]:
    """The picture of a board with something wrong about it, and the board that is looked for."""
    asked = sound.board
    if fault == "blurred":
        return replace(sound, blur_px=float(random.uniform(3.5, 6))).pixels, asked
    if fault == "from the side":
        return replace(sound, tilt_deg=float(random.uniform(75, 82))).pixels, asked
    if fault == "counts are wrong":
        return sound.pixels, replace(asked, columns=asked.columns - 1)
    if fault == "mirror images":
        return np.ascontiguousarray(sound.pixels[:, ::-1]), asked
    return replace(sound, dark=10, bright=float(random.uniform(12, 18)), noise=1.0).pixels, asked


def campaign(trials: int, seed: int) -> tuple[dict[str, float], float]:
    """Share of bad pictures of each kind that give no corners, and share of sound ones that do."""
    random = np.random.default_rng(seed)
    refused = dict.fromkeys(FAULTS, 0)
    accepted = 0
    for trial in range(trials):
        board = (CHARUCO, GRID)[trial % 2]
        sound = Photograph(
            board, float(random.uniform(28, 36)) * (1.25 if board is GRID else 1), float(random.uniform(0, 50)),
            float(random.uniform(0, 360)), float(random.uniform(0, 360)), blur_px=float(random.uniform(0.4, 1.0)), seed=trial,
        )  # fmt: skip
        accepted += isinstance(look(sound.pixels, board), Found)
        for fault in FAULTS:
            refused[fault] += isinstance(find_corners(*spoilt(sound, fault, random)), Refusal)
    return {fault: count / trials for fault, count in refused.items()}, accepted / trials


def test_bad_pictures_give_no_corners_and_sound_ones_do() -> None:
    refused, accepted = campaign(4, 1)
    assert min(refused.values()) == 1.0, refused
    assert accepted == 1.0


@pytest.mark.soak
def test_bad_pictures_give_no_corners_in_a_long_campaign() -> None:
    refused, accepted = campaign(120, 2)
    print("| bad pictures refused | " + " | ".join(f"{fault} {share:.1%}" for fault, share in refused.items()) + " |")
    print(f"| sound pictures accepted | {accepted:.1%} |")
    assert min(refused.values()) >= 0.95, refused
    assert accepted >= 0.95
