"""`prismstereo upsample`: its files say the same as its JSON, the grid is as the options say, nonsense is one line."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.command import in_process
from host.drawn_scenes import Disc
from prismstereo.cli.upsample import command
from prismstereo.fusion.upsampling import Flag, Grid, upsample
from prismstereo_hw import pfm
from prismstereo_hw.errors import DataError, UsageError

LOW, STILL = (36, 46), (144, 184)


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A map with a hole as PFM, and the still it belongs to as PNG."""
    disc = Disc()
    low = disc.low(LOW, Grid.between(LOW, STILL))
    low[4:6, 4:6] = np.nan
    pfm.write_disparity(tmp_path / "low.pfm", low)
    cv2.imwrite(str(tmp_path / "still.png"), disc.picture(STILL))
    return tmp_path / "low.pfm", tmp_path / "still.png"


@pytest.mark.parametrize("ending", [".pfm", ".png", ".npy"])
@pytest.mark.parametrize("method", ["edge-snap", "joint-bilateral"])
def test_the_file_holds_what_the_library_gives(
    files: tuple[Path, Path], tmp_path: Path, ending: str, method: str
) -> None:
    out = tmp_path / f"high{ending}"

    code, printed = in_process(command, *files, "--method", method, "-o", out, "--json")

    result, written = json.loads(printed), pfm.read_disparity(out)
    expected = upsample(pfm.read_disparity(files[0]), cv2.imread(str(files[1])), method)
    assert code == 0
    np.testing.assert_allclose(written, expected.disparity_px, atol=1 / 32 if ending == ".png" else 0)
    assert (result["width"], result["height"], result["method"]) == (184, 144, method)
    assert (result["scale_x"], result["shift_y_px"], result["density"]) == (4.0, 0.0, 1.0)
    assert result["band_pixels"] == int(((expected.flags & Flag.BAND) != 0).sum()) > 500
    assert result["milliseconds"] > 0


def test_holes_stay_and_flags_are_written_on_request(files: tuple[Path, Path], tmp_path: Path) -> None:
    out, flags = tmp_path / "high.npy", tmp_path / "flags.png"

    _, printed = in_process(command, *files, "--keep-holes", "--flags", flags, "-o", out, "--json")

    result, marks = json.loads(printed), cv2.imread(str(flags), cv2.IMREAD_GRAYSCALE)
    empty = np.isnan(np.load(out))
    np.testing.assert_array_equal(empty, (marks & Flag.FILLED) != 0)
    assert result["filled_pixels"] == empty.sum() == 64


def test_a_still_that_shows_more_than_the_video_is_empty_there(files: tuple[Path, Path], tmp_path: Path) -> None:
    taller = cv2.copyMakeBorder(cv2.imread(str(files[1])), 30, 20, 0, 0, cv2.BORDER_REFLECT)
    cv2.imwrite(str(tmp_path / "taller.png"), taller)
    arguments = files[0], tmp_path / "taller.png", "-o", tmp_path / "high.npy", "--json"

    with pytest.raises(
        UsageError, match=r"4 times as wide but 5\.389 times as high: they do not show the same, give --scale"
    ):
        in_process(command, *arguments)
    _, printed = in_process(command, *arguments, "--scale", 4, "--shift", 0, 5)

    result, found = json.loads(printed), np.load(tmp_path / "high.npy")
    assert result["shift_y_px"] == 30.0
    assert result["no_low_resolution_pixels"] == 50 * 184
    assert np.isnan(found[:30]).all()
    assert np.isnan(found[174:]).all()
    assert np.isfinite(found[30:174]).all()


def test_what_cannot_be_done_is_said_before_any_work(files: tuple[Path, Path], tmp_path: Path) -> None:
    for arguments, error, complaint in (
        ((*files, "-o", tmp_path / "x.tif"), UsageError, "a disparity file ends in .pfm, .png, .npy"),
        ((*files, "-o", tmp_path / "x.pfm", "--flags", tmp_path / "f.jpg"), UsageError, "this picture is a PNG"),
        ((*files, "-o", tmp_path / "x.pfm", "--scale", "0.5"), UsageError, "scale_x is 0.5: a still has 1 to 64"),
        ((*files, "-o", tmp_path / "x.pfm", "--scale", "nan"), UsageError, "scale_x is nan"),
        ((files[1], files[1], "-o", tmp_path / "x.pfm"), DataError, "a disparity PNG has one 16-bit channel"),
        ((files[0], tmp_path / "none.jpg", "-o", tmp_path / "x.pfm"), DataError, "cannot read"),
    ):
        with pytest.raises(error, match=complaint):
            in_process(command, *arguments)
    assert not (tmp_path / "x.pfm").exists()
