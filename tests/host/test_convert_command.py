"""`prismstereo convert` as a user meets it: files, notes, JSON, complaints with their exit codes."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from prismstereo import cli
from prismstereo_calibration import store
from prismstereo_calibration.model import Calibration
from prismstereo_hw.rig import Rig

Run = Callable[..., tuple[int, str, str]]
FILES = {
    "ros": ["left.yaml", "right.yaml"],
    "opencv": [],
    "kalibr": [],
    "luxonis": [],
    "colmap": ["cameras.txt", "images.txt", "points3D.txt", "rig_config.json"],
}


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """The program within this process: exit code, stdout, stderr."""
    monkeypatch.setitem(cli.VERBS, "convert", "interchange")

    def go(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["prismstereo", "convert", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        said = capsys.readouterr()
        assert "Traceback" not in said.err
        return int(ended.value.code or 0), said.out, said.err

    return go


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """The calibration file of an OAK-1 as pinholes."""
    store.write(tmp_path / "unit.json", Calibration.nominal(Rig.read("oak-1")).pinholes())
    return tmp_path / "unit.json"


@pytest.mark.parametrize("form", FILES)
def test_a_calibration_goes_there_and_comes_back(form: str, run: Run, unit: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, said, notes = run(unit, "--to", form, "-o", out, "--json")
    assert code == 0, notes
    result: dict[str, Any] = json.loads(said)
    assert [Path(file).name for file in result["files"]] == (FILES[form] or ["out"])
    assert all(Path(file).is_file() for file in result["files"])
    assert result["lengths_in"] == {"ros": "m", "kalibr": "m", "luxonis": "cm"}.get(form, "mm")
    assert "left camera's picture is 640x720 px cut out of the raw frame at 640, 0" in notes

    code, said, notes = run("--from", form, out, "--rig", "oak-1", "-o", tmp_path / "back.json", "--json")
    assert code == 0, notes
    assert "the range 400:inf mm is from oak-1" in notes
    before, after = store.read(unit), store.read(tmp_path / "back.json")
    assert json.loads(said)["baseline_mm"] == pytest.approx(before.baseline, rel=1e-9)
    assert after.views == before.views
    assert (after.frame_width, after.frame_height, after.range) == (1280, 720, before.range)
    assert after.left.lens.cx_px == pytest.approx(before.left.lens.cx_px, rel=1e-9)


def test_with_a_layout_the_range_is_that_of_the_labels_or_of_the_wish(run: Run, unit: Path, tmp_path: Path) -> None:
    run(unit, "--to", "kalibr", "-o", tmp_path / "chain.yaml")
    back = tmp_path / "back.json"
    code, _, notes = run("--from", "kalibr", tmp_path / "chain.yaml", "--layout", "swapped", "-o", back)
    assert code == 0, notes
    assert "the 128 labels searched" in notes
    assert store.read(back).range.labels == 128
    wished = ("--layout", "swapped", "--range-mm", "500:2000")
    assert run("--from", "kalibr", tmp_path / "chain.yaml", *wished, "-o", back)[0] == 0
    assert (store.read(back).range.near_mm, store.read(back).range.far_mm) == (500, 2000)


def test_glass_is_left_out_and_said_in_pixels(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    behind = Calibration.nominal(Rig.read("oak-1"))
    monkeypatch.setattr(store, "read", lambda path: behind)
    code, said, notes = run("unit.json", "--to", "opencv", "-o", tmp_path / "stereo.yml", "--json")
    assert code == 0
    assert json.loads(said)["glass_rms_px"] == pytest.approx(behind.nearest_pinholes().residual_px)
    assert "px rms" in notes


COMPLAINTS: dict[str, tuple[int, tuple[str, ...], str]] = {
    "no direction": (2, ("UNIT",), "--to FORMAT"),
    "both directions": (2, ("UNIT", "--to", "ros", "--from", "ros"), "--to FORMAT"),
    "a rig on the way there": (2, ("UNIT", "--to", "ros", "--rig", "oak-1"), "go with --from"),
    "no rig on the way back": (2, ("CHAIN", "--from", "kalibr"), "--layout side-by-side"),
    "two calibrations": (2, ("UNIT", "UNIT", "--to", "ros"), "2 files given"),
    "no calibration": (4, ("CHAIN", "--to", "ros"), "is not JSON"),
    "another format": (4, ("UNIT", "--from", "kalibr", "--rig", "oak-1"), "has no field 'cam0'"),
    "another frame": (4, ("CHAIN", "--from", "kalibr", "--layout", "swapped", "--frame-px", "640x480"), "640x480"),
    "no frame": (2, ("CHAIN", "--from", "kalibr", "--layout", "swapped", "--frame-px", "big"), "e.g. 1280x720"),
}


@pytest.mark.parametrize("name", COMPLAINTS)
def test_what_cannot_be_converted_is_refused_in_one_line(name: str, run: Run, unit: Path, tmp_path: Path) -> None:
    chain = tmp_path / "chain.yaml"
    run(unit, "--to", "kalibr", "-o", chain)
    code, words, message = COMPLAINTS[name]
    given = [{"UNIT": unit, "CHAIN": chain}.get(word, word) for word in words]
    found, _, complaint = run(*given, "-o", tmp_path / "never")
    assert found == code, complaint
    assert message in complaint
    assert not (tmp_path / "never").exists()
