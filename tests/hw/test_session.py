"""A session folder: written piece by piece, read back the same, and clear about what is missing."""

from __future__ import annotations

import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prismstereo_hw.errors import DataError, ImageError, SessionError
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.optics.unfold import fold
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import named
from prismstereo_hw.session import Session, SessionWriter
from prismstereo_hw.twin import Twin


@pytest.fixture(scope="module")
def twin(small: Rig) -> Twin:
    return Twin(small, named(small, "desk"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, small: Rig, twin: Twin) -> Path:
    """A whole session: three video frames with their truth, a still and a board view."""
    folder = tmp_path_factory.mktemp("sessions") / "desk"
    writer = SessionWriter(folder, small, "desk")
    for index in range(3):
        writer.add("video", twin.frame(index))
        writer.add_truth(index, twin.truth(index))
    writer.add("stills", twin.frame(0))
    writer.add("boards", twin.frame(7))
    writer.finish(board="chessboard:9x7", square_mm=12.5)
    return folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    """A copy of the whole session, to be damaged."""
    return Path(shutil.copytree(whole, tmp_path / "copy"))


def test_frames_come_back_in_order_with_their_times(whole: Path, twin: Twin) -> None:
    frames = list(Session.open(whole).frames("video"))
    assert [frame.index for frame in frames] == [0, 1, 2]
    for frame in frames:
        original = twin.frame(frame.index)
        np.testing.assert_array_equal(frame.pixels, original.pixels)
        assert frame.timestamp_us == original.timestamp_us
    board = next(Session.open(whole).frames("boards"))
    assert (board.index, board.timestamp_us) == (7, round(7e6 / 30))


def test_board_stills_go_with_the_board_views_by_their_number(tmp_path: Path, small: Rig, twin: Twin) -> None:
    writer = SessionWriter(tmp_path / "s", small)
    for kind, index in (("boards", 0), ("boards", 1), ("boards_still", 1)):
        writer.add(kind, replace(twin.frame(0), index=index, timestamp_us=10 * index + len(kind)))
    writer.finish()

    session = Session.open(tmp_path / "s")
    assert (session.info.board_frames, session.info.board_still_frames) == (2, 1)
    assert [path.name for path in session.paths("boards")] == ["000000.png", "000001.png"]
    assert [path.name for path in session.paths("boards_still")] == ["000001.png"]
    assert next(session.frames("boards_still")).timestamp_us == 22
    session.paths("boards_still")[0].unlink()
    with pytest.raises(SessionError, match="boards_still holds 0 of the 1 pictures"):
        session.paths("boards_still")


def test_a_session_without_board_stills_says_nothing_that_older_readers_do_not_know(whole: Path) -> None:
    assert "board_still" not in (whole / "session.toml").read_text()
    assert Session.open(whole).paths("boards_still") == []


def test_the_truth_comes_back(whole: Path, twin: Twin) -> None:
    read, true = Session.open(whole).truth(2), twin.truth(2)
    for part in ("depth_mm", "match_px", "occluded", "objects"):
        np.testing.assert_array_equal(getattr(read, part), getattr(true, part))
        assert getattr(read, part).dtype == getattr(true, part).dtype


def test_session_toml_says_what_is_there(whole: Path, small: Rig) -> None:
    info = Session.open(whole).info
    assert (info.rig, info.scene, info.board, info.square_mm) == ("oak-1", "desk", "chessboard:9x7", 12.5)
    assert (info.video_width, info.video_height, info.video_rate_hz) == (320, 180, 30.0)
    assert (info.video_frames, info.still_frames, info.board_frames, info.truth) == (3, 1, 1, True)
    assert Rig.read(whole / "rig.toml") == small


def test_the_true_lens_and_poses_are_plain_numbers(whole: Path, small: Rig) -> None:
    true = tomllib.loads((whole / "truth" / "lens.toml").read_text())
    R, t = np.array(true["R_right_from_left"]), np.array(true["t_right_from_left_mm"])
    point = np.array([20.0, -10.0, 800.0])
    left, right = (fold(small, side).view_from_rig(point) for side in ("left", "right"))
    np.testing.assert_allclose(R @ left + t, right, atol=1e-9)
    assert true["baseline_mm"] == pytest.approx(float(np.linalg.norm(t)))
    assert (true["focal_px"], true["plate_index"]) == (small.lens().fx_px, small.prism.index)


def test_numbers_not_names_make_the_order(tmp_path: Path, small: Rig, twin: Twin) -> None:
    writer = SessionWriter(tmp_path / "long", small)
    pixels = twin.frame().pixels
    for index in (1_000_000, 999_999, 2):
        writer.add("video", RawFrame(pixels, index, index))
    writer.finish()
    assert [frame.index for frame in Session.open(tmp_path / "long").frames()] == [2, 999_999, 1_000_000]


def test_colour_frames_come_back(tmp_path: Path, small: Rig, rng: np.random.Generator) -> None:
    pixels = rng.integers(0, 256, (180, 320, 3), np.uint8)
    writer = SessionWriter(tmp_path / "colour", small)
    writer.add("video", RawFrame(pixels))
    writer.finish()
    np.testing.assert_array_equal(next(Session.open(tmp_path / "colour").frames()).pixels, pixels)


def test_a_session_without_frames_is_a_session(tmp_path: Path, small: Rig) -> None:
    SessionWriter(tmp_path / "empty", small).finish()
    session = Session.open(tmp_path / "empty")
    assert list(session.frames()) == []
    assert session.calibration_path is None


def test_a_calibration_in_the_folder_is_found(folder: Path) -> None:
    assert Session.open(folder).calibration_path is None
    (folder / "calibration.json").write_text("{}")
    assert Session.open(folder).calibration_path == folder / "calibration.json"


# ---- half-written and damaged sessions


def test_a_half_written_folder_has_no_session_toml_and_is_no_session(tmp_path: Path, small: Rig, twin: Twin) -> None:
    writer = SessionWriter(tmp_path / "half", small)
    writer.add("video", twin.frame())
    assert not (tmp_path / "half" / "session.toml").exists()
    with pytest.raises(SessionError, match=r"half is no session: session.toml is missing"):
        Session.open(tmp_path / "half")


def test_nothing_is_written_over_a_session_or_half_of_one(tmp_path: Path, small: Rig, twin: Twin, folder: Path) -> None:
    SessionWriter(tmp_path / "half", small).add("video", twin.frame(5))
    for taken in (folder, tmp_path / "half"):
        with pytest.raises(DataError, match="already holds a session, or half of one: give another folder"):
            SessionWriter(taken, small)


@pytest.mark.parametrize("name", ["missing", "a" * 5000])
def test_a_folder_that_is_not_there_is_no_session(tmp_path: Path, name: str) -> None:
    with pytest.raises(SessionError, match=r"is no session: session.toml is missing"):
        Session.open(tmp_path / name)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'schema = "prismstereo-session/1"',
            'schema = "prismstereo-session/2"',
            r"Invalid enum value .* at `\$.schema`",
        ),
        ("video_frames = 3", "", None),  # what is not said is none
        ('rig = "oak-1"', "", "missing required field `rig`"),
        ("truth = true", "truth = 1", r"Expected `bool`, got `int` - at `\$.truth`"),
        ("truth = true", "lies = true", "unknown field `lies`"),
        ("truth = true", "truth", "cannot be understood"),
        ("truth = true", "truth = " + "[" * 20_000, "cannot be understood"),
    ],
)
def test_a_session_toml_that_says_something_else_is_refused(
    folder: Path, old: str, new: str, words: str | None
) -> None:
    path = folder / "session.toml"
    path.write_text(path.read_text().replace(old, new))
    if words is None:
        assert Session.open(folder).info.video_frames == 0
    else:
        with pytest.raises(SessionError, match=words):
            Session.open(folder)


def test_a_session_toml_that_is_not_text_or_is_huge_is_refused(folder: Path) -> None:
    (folder / "session.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SessionError, match=r"session.toml cannot be understood"):
        Session.open(folder)
    (folder / "session.toml").write_bytes(b"#" * (1024 * 1024 + 1))
    with pytest.raises(SessionError, match=r"a session.toml has at most 1048576"):
        Session.open(folder)


def _read_all(folder: Path) -> None:
    session = Session.open(folder)
    for kind in ("video", "stills", "boards"):
        list(session.frames(kind))
    session.truth(1)


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ("session.toml", "session.toml is missing"),
        ("video/000001.png", r"video holds 2 of the 3 pictures that session.toml counts: copy the session again"),
        ("stills/000000.png", "stills holds 0 of the 1 pictures"),
        ("boards/000007.png", "boards holds 0 of the 1 pictures"),
        ("timestamps.csv", r"timestamps.csv has no time for 000000.png of video: add the line video,0,MICROSECONDS"),
        ("truth/depth/000001.pfm", "holds no readable truth of frame 1: cannot read .*000001.pfm"),
        ("truth/match/000001.npy", "holds no readable truth of frame 1: .*000001.npy"),
        ("truth/occluded/000001.png", "holds no readable truth of frame 1: cannot read .*occluded"),
        ("truth/objects/000001.png", "holds no readable truth of frame 1: cannot read .*objects"),
    ],
)
def test_each_missing_part_is_one_clear_error(folder: Path, part: str, words: str) -> None:
    _read_all(folder)
    (folder / part).unlink()
    with pytest.raises(SessionError, match=words):
        _read_all(folder)


def test_truth_that_contradicts_itself_is_refused(folder: Path) -> None:
    np.save(folder / "truth" / "match" / "000001.npy", np.zeros((3, 4, 2), np.float32))
    with pytest.raises(SessionError, match=r"the truth of frame 1 contradicts itself, .*match float32 \(3, 4, 2\)"):
        Session.open(folder).truth(1)


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY", b"junk"])
def test_a_damaged_truth_is_one_clear_error(folder: Path, content: bytes) -> None:
    (folder / "truth" / "match" / "000001.npy").write_bytes(content)
    with pytest.raises(SessionError, match="holds no readable truth of frame 1"):
        Session.open(folder).truth(1)


def test_a_session_without_truth_says_so(tmp_path: Path, small: Rig, twin: Twin) -> None:
    writer = SessionWriter(tmp_path / "real", small)
    writer.add("video", twin.frame())
    writer.finish()
    assert not (tmp_path / "real" / "truth").exists()
    with pytest.raises(SessionError, match="holds no truth: only sessions of the optical twin do"):
        Session.open(tmp_path / "real").truth(0)


@pytest.mark.parametrize(
    "line",
    ["video", "video,0", "video,zero,1", "video,0,1.5", "video,0,1,2", "video,0," + "9" * 5000, "x" * 200_000, "\0"],
)
def test_a_line_of_times_that_cannot_be_read_is_named(folder: Path, line: str) -> None:
    path = folder / "timestamps.csv"
    path.write_text(f"kind,index,timestamp_us\nvideo,0,0\n{line}\n")
    with pytest.raises(SessionError, match=r"timestamps.csv, line 3: .*: each line is kind,index,microseconds"):
        Session.open(folder)


def test_times_that_are_no_text_are_refused(folder: Path) -> None:
    (folder / "timestamps.csv").write_bytes(b"kind,index,timestamp_us\n\xff\xff")
    with pytest.raises(SessionError, match=r"timestamps.csv cannot be read: .*: copy the session again"):
        Session.open(folder)


def test_empty_lines_and_strange_files_do_no_harm(folder: Path) -> None:
    with (folder / "timestamps.csv").open("a") as file:
        file.write("\n\n")
    for name in ("Thumbs.db", "²³.png", "000001.txt", ".000001.png.part"):
        (folder / "video" / name).write_bytes(b"?")
    assert len(list(Session.open(folder).frames())) == 3


def test_a_frame_that_is_cut_off_is_named(folder: Path) -> None:
    path = folder / "video" / "000002.png"
    path.write_bytes(path.read_bytes()[:-20])
    frames = Session.open(folder).frames()
    assert next(frames).index == 0
    assert next(frames).index == 1
    with pytest.raises(ImageError, match=r"000002.png is cut off"):
        next(frames)
