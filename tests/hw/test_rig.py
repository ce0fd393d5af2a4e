"""Rig files: the built-in ones, what is refused and in which words, and the way to TOML and back."""

from __future__ import annotations

import math
import re
from pathlib import Path

import msgspec
import pytest
import tomli_w

from prismstereo_hw.errors import RigError
from prismstereo_hw.rig import BUILT_IN, Mode, RangeWish, Rig


def edited(path: str, value: object) -> str:
    """The text of the oak-1 rig file with one value changed; None takes it out."""
    tree = msgspec.to_builtins(Rig.read("oak-1"))
    *parents, last = path.split(".")
    branch = tree
    for parent in parents:
        branch = branch[parent]
    if value is None:
        del branch[last]
    else:
        branch[last] = value
    return tomli_w.dumps(tree)


def refusal(text: str) -> str:
    """What `Rig.parse` says to a rig file that is wrong; always with its name first."""
    with pytest.raises(RigError) as caught:
        Rig.parse(text, "mine.toml")
    assert str(caught.value).startswith("mine.toml")
    return str(caught.value)


def test_every_built_in_rig_can_be_built(rig: Rig) -> None:
    assert rig.name in BUILT_IN
    assert rig.prism.index == pytest.approx(1.5168, abs=1e-4)
    assert rig.range.far_mm == math.inf


def test_the_principal_point_and_focal_length_follow_from_the_field_of_view(rig: Rig) -> None:
    lens, video = rig.lens(), rig.camera.video
    border = (video.width / 2) / lens.fx_px
    assert math.degrees(2 * math.atan(border)) == pytest.approx(rig.camera.hfov_deg)
    assert (lens.cx_px, lens.cy_px) == ((video.width - 1) / 2, (video.height - 1) / 2)


def test_a_still_sees_as_wide_as_the_video_with_more_pixels(rig: Rig) -> None:
    video, still = rig.lens(), rig.lens(rig.camera.still)
    scale = rig.camera.still.width / rig.camera.video.width
    assert still.fx_px == pytest.approx(scale * video.fx_px)
    assert still.cx_px == pytest.approx(video.scaled(scale).cx_px)


def test_the_right_half_of_the_frame_is_the_left_view(rig: Rig) -> None:
    left, right = rig.views
    assert left.rectangle(1280, 720) == (640, 0, 640, 720)
    assert right.rectangle(1280, 720) == (0, 0, 640, 720)


def test_a_rig_comes_back_from_its_own_toml(rig: Rig) -> None:
    assert Rig.parse(rig.toml(), "again") == rig


def test_a_rig_file_is_read_by_its_path(tmp_path: Path, rig: Rig) -> None:
    path = tmp_path / "copy.toml"
    path.write_text(rig.toml(), "utf-8")
    assert Rig.read(path) == rig
    assert Rig.read(str(path)) == rig


def test_a_byte_order_mark_from_an_editor_does_no_harm(tmp_path: Path, oak: Rig) -> None:
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + oak.toml().replace("\n", "\r\n").encode())
    assert Rig.read(path) == oak


VALUE_RULE_AND_MEND = [
    ("camera.hfov_deg", 4.9, "camera.hfov_deg is 4.9, but one lens for two views sees between 5 and 120"),
    ("camera.hfov_deg", 121.0, "give the full horizontal field of the video mode"),
    ("camera.pupil_diameter_mm", 0.0, "camera.pupil_diameter_mm is 0: give focal length over f-number, 0 to 60"),
    ("camera.pupil_diameter_mm", 61.0, "give focal length over f-number"),
    ("camera.video.width", 1281, "camera.video is 1281x720: give an even width from 64"),
    ("camera.video.width", 62, "camera.video is 62x720"),
    ("camera.still.height", 47, "camera.still is 4056x47: give an even width from 64 and a height from 48 to 16384"),
    ("camera.still.width", 20000, "camera.still is 20000x3040"),
    ("camera.video.rate_hz", 0.0, "camera.video.rate_hz is 0: give frames per second"),
    ("camera.video.rate_hz", -30.0, "camera.video.rate_hz is -30"),
    ("camera.principal_offset_px", [321.0, 0.0], "meets the sensor within a quarter of the frame"),
    ("camera.principal_offset_px", [0.0, -181.0], "camera.principal_offset_px is (0.0, -181.0)"),
    ("camera.distortion", [11.0, 0.0], "camera.distortion is (11.0, 0.0): give k1 and k2 between -10 and 10"),
    ("camera.distortion", [-0.9, 0.0], "folds the video picture before its corners: give the k1 and k2 of a lens"),
    ("camera.distortion", [-0.22, 0.0], "folds the still picture before its corners"),
    ("prism.side_mm", 0.5, "prism.side_mm is 0.5: give millimetres between 1 and 1000"),
    ("prism.length_mm", 1001.0, "prism.length_mm is 1001: give millimetres between 1 and 1000"),
    ("prism.pupil_to_prism_mm", 0.0, "prism.pupil_to_prism_mm is 0: the prism stands in front of the lens"),
    ("prism.pupil_to_prism_mm", 501.0, "prism.pupil_to_prism_mm is 501"),
    ("prism.pupil_to_prism_mm", 20.0, "bring the prism nearer than 18.5 mm, or take a larger one"),
    ("prism.glass", "1.15", "has index 1.1500: below 1.155 an equilateral prism reflects nothing"),
    ("prism.glass", "chocolate", "there is no glass 'chocolate': choose one of N-BK7"),
    ("mirrors.angle_deg", 45.0, "mirrors.angle_deg is 45: behind an equilateral prism both views look forward only"),
    ("mirrors.angle_deg", 75.0, "60 - hfov/8 makes them parallel"),
    ("mirrors.length_mm", 0.9, "mirrors.length_mm is 0.9: give millimetres between 1 and 2000"),
    ("mirrors.height_mm", 2001.0, "mirrors.height_mm is 2001: give millimetres between 1 and 2000"),
    ("mirrors.left_tip_deg", 5.1, "mirrors.left_tip_deg is 5.1: a mount that is off by more than 5 degrees is broken"),
    ("mirrors.right_tip_deg", -5.1, "mirrors.right_tip_deg is -5.1"),
    ("mirrors.near_edge_mm", 6.0, "mirrors.near_edge_mm is 6, inside the prism, which reaches 6.6 mm from the axis"),
    ("mirrors.near_edge_mm", 2001.0, "mirrors.near_edge_mm is 2001: give at most 2000 millimetres"),
    ("mirrors.offset_mm", 4000.0, "mirrors.offset_mm is 4000: give at most 2000 millimetres"),
    ("mirrors.offset_mm", -100.0, None),  # beside the lens: odd, but it can be built
    ("range.near_mm", 0.0, "range 0:inf mm is empty: give near < far, both positive"),
    ("range.far_mm", 400.0, "range 400:400 mm is empty"),
    ("range.labels", 100, "100 disparity labels: give a multiple of 16 between 16 and 1024"),
    ("range.labels", 0, "0 disparity labels"),
    ("range.labels", 1040, "1040 disparity labels"),
    ("kind", "pancake", "'pancake' - at `$.kind`"),
]


@pytest.mark.parametrize(("path", "value", "words"), VALUE_RULE_AND_MEND)
def test_what_cannot_be_built_is_refused_with_the_value_the_rule_and_the_mend(
    path: str, value: object, words: str | None
) -> None:
    if words is None:
        assert Rig.parse(edited(path, value), "mine.toml")
    else:
        assert words in refusal(edited(path, value))


NUMBERS = [
    f"{table}.{field}"
    for table, fields in {
        "camera": ("hfov_deg", "pupil_diameter_mm"),
        "camera.video": ("rate_hz",),
        "prism": ("side_mm", "length_mm", "pupil_to_prism_mm"),
        "mirrors": (
            "angle_deg", "near_edge_mm", "offset_mm", "length_mm", "height_mm", "left_tip_deg", "right_tip_deg",
        ),
        "range": ("near_mm",),
    }.items()
    for field in fields
]  # fmt: skip


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("path", NUMBERS)
def test_no_number_may_be_infinite_or_none_at_all(path: str, value: float) -> None:
    assert path.rpartition(".")[2].removesuffix("_mm") in refusal(edited(path, value))


@pytest.mark.parametrize("pair", [[math.nan, 0.0], [0.0, math.inf]])
@pytest.mark.parametrize("path", ["camera.principal_offset_px", "camera.distortion"])
def test_nor_may_one_of_a_pair(path: str, pair: list[float]) -> None:
    assert path in refusal(edited(path, pair))


def test_the_far_end_may_be_infinite_but_not_undefined() -> None:
    assert Rig.parse(edited("range.far_mm", math.inf), "mine.toml").range.far_mm == math.inf
    assert "is empty" in refusal(edited("range.far_mm", math.nan))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("prism.colour", "blue", "unknown field `colour` - at `$.prism`"),
        ("zoom", 2, "unknown field `zoom`"),
        ("prism.glass", None, "missing required field `glass` - at `$.prism`"),
        ("mirrors", None, "missing required field `mirrors`"),
        ("camera.video.width", None, "missing required field `width` - at `$.camera.video`"),
        ("prism.side_mm", "25.4", "Expected `float`, got `str` - at `$.prism.side_mm`"),
        ("camera.video.width", 1280.5, "Expected `int`, got `float` - at `$.camera.video.width`"),
        ("camera.distortion", [0.1], "Expected `array` of length 2, got 1 - at `$.camera.distortion`"),
        ("name", 7, "Expected `str`, got `int` - at `$.name`"),
        ("prism.side_mm", True, "Expected `float`, got `bool` - at `$.prism.side_mm`"),
    ],
)
def test_unknown_missing_and_mistyped_fields_are_refused_with_their_path(path: str, value: object, words: str) -> None:
    message = refusal(edited(path, value))
    assert words in message
    assert "compare with the built-in rigs" in message


@pytest.mark.parametrize(
    "text",
    ["name = ", "[camera", "name = 'a'\nname = 'b'", "\x00", "a = " + "[" * 20_000, "a = " + "{a = " * 20_000],
    ids=["no value", "no bracket", "twice", "nul", "deep arrays", "deep tables"],
)
def test_what_is_not_toml_is_refused(text: str) -> None:
    assert "is not TOML" in refusal(text)


def test_an_empty_file_misses_its_first_field() -> None:
    assert "missing required field" in refusal("")


def test_a_file_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes('name = "Spiegelträger"'.encode("latin-1"))
    with pytest.raises(RigError, match=rf"{re.escape(str(path))} cannot be read as UTF-8 text"):
        Rig.read(path)


def test_a_huge_file_is_refused_unread(tmp_path: Path, oak: Rig) -> None:
    path = tmp_path / "huge.toml"
    path.write_text(oak.toml() + "#" * 256 * 1024)
    with pytest.raises(RigError, match=r"has \d+ bytes: a rig file has at most 262144"):
        Rig.read(path)


@pytest.mark.parametrize("source", ["oak1", "", ".", "no/such/rig.toml", "a" * 5000, "nul\0byte"])
def test_a_rig_that_is_not_there_is_refused_with_the_names_there_are(source: str) -> None:
    with pytest.raises(RigError, match=r"there is no rig .*: give one of dslr-35mm, .*, or the path"):
        Rig.read(source)


def test_a_range_wish_stands_for_itself() -> None:
    assert RangeWish(near_mm=1.0, far_mm=math.inf, labels=16).labels == 16
    with pytest.raises(RigError, match="is empty"):
        RangeWish(near_mm=math.inf, far_mm=math.inf, labels=16)


def test_what_was_read_cannot_be_changed(oak: Rig) -> None:
    with pytest.raises(AttributeError):
        oak.name = "other"  # type: ignore[misc]
    with pytest.raises(AttributeError):
        Mode(width=64, height=48).width = 0  # type: ignore[misc]
