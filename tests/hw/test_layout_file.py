"""Where the views lie, from a TOML file: for optics of which there is no rig file."""

from __future__ import annotations

from pathlib import Path

import pytest

from prismstereo_hw.errors import RigError, UsageError
from prismstereo_hw.view import View, layout, read_layout

MIRROR = """
[left]
left = 0
top = 0.0
width = 0.55
height = 1.0
polygon = [[0.0, 0.0], [0.55, 0.0], [0.48, 0.3], [0.5, 1.0], [0.0, 1.0]]

[right]
left = 0.585
top = 0.0
width = 0.415
height = 1.0
mirrored = true
"""
THIRD = "[below]\nleft = 0.0\ntop = 0.5\nwidth = 1.0\nheight = 0.5\nturn_deg = 90\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "mirror.toml"
    path.write_text(text, "utf-8")
    return path


def test_a_layout_file_says_where_both_views_lie(tmp_path: Path) -> None:
    left, right = layout(str(written(tmp_path, MIRROR)))
    assert left.rectangle(4000, 3000) == (0, 0, 2200, 3000)
    assert left.polygon[2] == (0.48, 0.3)
    assert right == View(left=0.585, top=0.0, width=0.415, height=1.0, mirrored=True)


def test_further_views_come_after_left_and_right_in_any_order_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, THIRD + MIRROR)
    left, right, below = read_layout(path)
    assert (left.left, right.mirrored, below.turn_deg) == (0.0, True, 90)
    assert layout(path) == (left, right)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (MIRROR.replace("mirrored", "flipped"), r"\[right\].*flipped"),
        (MIRROR.replace("width = 0.415", 'width = "half"'), r"\[right\].*width"),
        (MIRROR.replace("width = 0.415\n", ""), r"\[right\].*width"),
        (MIRROR.replace("left = 0.585", "left = 0.7"), r"\[right\].*leaves the frame"),
        (MIRROR.replace("left = 0.585", "left = nan"), r"\[right\].*leaves the frame"),
        (MIRROR.replace("[left]", "[lft]"), r"no table \[left\]"),
        (MIRROR + "[left]\n", "is not TOML"),
        ("left = 3", "is not a layout"),
    ],
)
def test_what_is_wrong_in_a_layout_file_is_named_with_its_table(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(RigError, match=complaint) as refused:
        layout(str(written(tmp_path, text)))
    assert "mirror.toml" in str(refused.value)


def test_a_layout_file_that_is_not_there_or_far_too_large_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        layout(str(tmp_path / "none.toml"))
    with pytest.raises(UsageError, match="more than 65536 bytes"):
        layout(written(tmp_path, "#" * 70_000))
