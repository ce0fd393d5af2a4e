"""`prismstereo match`: its options reach the matcher, its files say the same as its JSON, and nothing is half written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from device.shifted_noise import grey, noise
from device.stereo_models import block_matcher
from host.command import complaint_of, result_of
from prismstereo.cli.match import command
from prismstereo_device.reasons import Reason
from prismstereo_hw import pfm
from prismstereo_hw.errors import PrismStereoError, UsageError

SHIFT_PX = 7


@pytest.fixture
def pair(rng: np.random.Generator, tmp_path: Path) -> tuple[Path, Path]:
    """Files of a cloudy pair whose disparity is 7, with a flat patch in rows 30 to 70 and columns 100 to 150."""
    picture = noise(rng, 120, 200)
    picture[30:70, 100:150] = 128.0
    paths = tmp_path / "left.png", tmp_path / "right.png"
    for path, pixels in zip(paths, (picture, np.roll(picture, -SHIFT_PX, axis=1)), strict=True):
        cv2.imwrite(str(path), grey(pixels))
    return paths


def match(*arguments: object) -> dict[str, Any]:
    """Run the verb within this process and return its JSON object; a complaint of ours is raised."""
    done = CliRunner().invoke(command, [*map(str, arguments), "--json"])
    if done.exception is not None:
        raise done.exception
    found = json.loads(done.stdout)
    assert isinstance(found, dict)
    return found


def test_the_search_is_as_the_options_say(pair: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "d.npy"
    result = match(
        *pair, "--matcher", "sgbm", "--max-disparity", 32, "--min-disparity", 3, "--region", "40,10,60,80",
        "--subpixel-bits", 0, "--threads", 1, "-o", out,
    )  # fmt: skip
    disparity = np.load(out)
    assert result["valid_pixels"] == np.isfinite(disparity).sum()
    assert result["density"] == pytest.approx(result["valid_pixels"] / disparity.size)
    assert (result["matcher"], result["labels"], result["min_disparity"]) == ("sgbm", 32, 3)
    assert (result["width"], result["height"]) == (200, 120)
    assert result["milliseconds"] > 0
    assert np.mean(disparity[15:85, 45:95] == SHIFT_PX) > 0.9
    disparity[10:90, 40:100] = np.nan
    assert np.isnan(disparity).all()
    assert match(*pair, "--matcher", "sgbm", "--min-disparity", 9, "--max-disparity", 32, "-o", out)["density"] < 0.05


@pytest.mark.parametrize("name", ["sgbm-3way", "bm"])
def test_opencvs_plain_matchers_go_by_name(name: str, pair: tuple[Path, Path], tmp_path: Path) -> None:
    result = match(*pair, "--matcher", name, "--max-disparity", 32, "-o", tmp_path / "d.pfm")
    assert result["matcher"] == name
    assert np.nanmedian(pfm.read(tmp_path / "d.pfm")) == pytest.approx(SHIFT_PX, abs=0.1)


def test_a_learned_matcher_goes_by_its_file(pair: tuple[Path, Path], tmp_path: Path) -> None:
    model = block_matcher(tmp_path / "blocks.onnx", 16)
    result = match(
        *pair, "--matcher", f"onnx:{model},scale=none,check=yes", "--provider", "cpu", "--max-disparity", 16,
        "-o", tmp_path / "d.png",
    )  # fmt: skip
    assert result["matcher"] == f"onnx:{model},scale=none,check=yes,provider=cpu"
    disparity = pfm.read_disparity(tmp_path / "d.png")
    assert np.mean(disparity[5:25, 20:-20] == SHIFT_PX) > 0.99


def test_reasons_are_a_picture_of_codes_and_counted(pair: tuple[Path, Path], tmp_path: Path) -> None:
    result = match(
        *pair, "--matcher", "sgbm", "--max-disparity", 32, "--reasons", tmp_path / "why.png", "-o", tmp_path / "d.pfm"
    )
    reasons = cv2.imread(str(tmp_path / "why.png"), cv2.IMREAD_UNCHANGED)
    unmatched = np.isnan(pfm.read(tmp_path / "d.pfm"))
    np.testing.assert_array_equal(reasons == Reason.MATCHED, ~unmatched)
    assert sum(result["unmatched_pixels"].values()) == unmatched.sum()
    assert result["unmatched_pixels"]["weak_texture"] == np.count_nonzero(reasons == Reason.WEAK_TEXTURE)
    assert np.all(reasons[42:58, 112:138] == Reason.WEAK_TEXTURE)


def test_filters_work_on_what_was_matched(pair: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "half.toml").write_text('[[filters]]\nkind = "decimate"\nfactor = 2\n')
    result = match(
        *pair, "--matcher", "sgbm", "--max-disparity", 32, "--filters", tmp_path / "half.toml", "-o", tmp_path / "d.pfm"
    )
    disparity = pfm.read(tmp_path / "d.pfm")
    assert (result["width"], result["height"]) == disparity.shape[::-1] == (100, 60)
    assert result["filter_milliseconds"] > 0
    assert np.nanmedian(disparity) == pytest.approx(SHIFT_PX / 2, abs=0.05)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--region", "1,2,3"), r"--region 1,2,3: give X,Y,WIDTH,HEIGHT in whole pixels"),
        (("--region", "150,0,100,50"), r"region 150,0 100x50 leaves the rectified picture of 200x120"),
        (("--min-disparity", 128), "the search begins at 128, but the range has 128 labels"),
        (("--subpixel-bits", 9), "9 sub-pixel bits: give 0 .whole pixels. to 8"),
        (("--threads", 0), "0 threads: give 1 to 64"),
        (("--provider", "cpu"), r"--provider cpu goes with a learned matcher, onnx:MODEL.onnx, not sgbm"),
        (("--reasons", "why.jpg"), r"--reasons why.jpg: this picture is a PNG"),
        (("--confidence", "sure.pfm"), r"--confidence sure.pfm: this picture is a PNG"),
        (("--confidence", "sure.png"), r"sgbm does not tell how sure it is, leave it out"),
        (("--filters", "magic"), "there are no filters 'magic'"),
    ],
)
def test_a_wish_that_cannot_be_granted_writes_nothing(
    options: tuple[object, ...],
    complaint: str,
    pair: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(UsageError, match=complaint):
        match(*pair, "--matcher", "sgbm", *options, "-o", tmp_path / "d.pfm")
    assert sorted(tmp_path.iterdir()) == before


def test_a_model_that_is_none_ends_with_code_4_and_one_line(pair: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "bad.onnx").write_bytes(b"not a model")
    options = ("--matcher", f"onnx:{tmp_path / 'bad.onnx'},scale=none", "-o", tmp_path / "d.pfm")
    assert "is no model that onnxruntime can run" in complaint_of(4, "match", *pair, *options)
    with pytest.raises(PrismStereoError, match="is no model"):
        match(*pair, *options)


def test_a_process_of_its_own_says_the_same(pair: tuple[Path, Path], tmp_path: Path) -> None:
    options = (*pair, "--matcher", "bm", "--max-disparity", 32, "-o", tmp_path / "d.pfm")
    assert result_of("match", *options)["valid_pixels"] == match(*options)["valid_pixels"]
