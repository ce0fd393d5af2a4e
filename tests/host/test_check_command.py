"""`prismstereo check`: fine, refine or recalibrate, from frames of the twin."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from host.command import in_process
from prismstereo.cli.check import command
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.store import write
from prismstereo_hw.errors import UsageError
from prismstereo_hw.files import write_picture
from prismstereo_hw.kinds import PrismRig
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import facing_plane, named
from prismstereo_hw.twin import Twin


def tipped(rig: Rig, tip_deg: float) -> PrismRig:
    assert isinstance(rig, PrismRig)
    return msgspec.structs.replace(rig, mirrors=msgspec.structs.replace(rig.mirrors, right_tip_deg=tip_deg))


def frame_of(rig: PrismRig, path: Path, scene: str = "plane:800") -> Path:
    shown = facing_plane(rig, 800.0) if scene == "plane:800" else named(rig, scene)
    write_picture(path, Twin(rig, shown).frame().pixels)
    return path


@pytest.fixture
def unit(small: Rig, tmp_path: Path) -> Path:
    path = tmp_path / "unit.json"
    write(path, Calibration.nominal(small))
    return path


def run(*arguments: object) -> tuple[int, str]:
    return in_process(command, *arguments)


def result_of(*arguments: object) -> tuple[int, dict[str, Any]]:
    code, said = run(*arguments, "--json")
    found = json.loads(said)
    assert isinstance(found, dict)
    return code, found


def test_a_unit_that_stands_as_it_was_is_fine(small: Rig, unit: Path, tmp_path: Path) -> None:
    code, found = result_of(frame_of(tipped(small, 0.0), tmp_path / "a.png"), "--calibration", unit)

    assert (code, found["advice"], found["cause"]) == (0, "fine", "")
    assert found["matches"] > 100
    assert {"name", "value", "fine_up_to", "refine_up_to", "unit", "advice"} == set(found["findings"][0])


def test_a_tipped_mirror_is_told_with_figures_and_limits(small: Rig, unit: Path, tmp_path: Path) -> None:
    code, said = run(frame_of(tipped(small, 0.3), tmp_path / "a.png"), "--calibration", unit)

    assert code == 1
    assert "REFINE" in said
    assert "a mirror has tipped" in said
    assert "refine up to" in said


def test_a_board_tells_of_lengths(oak: Rig, tmp_path: Path) -> None:
    video = Mode(width=640, height=360, rate_hz=30.0)
    half = msgspec.structs.replace(tipped(oak, 0.0), camera=msgspec.structs.replace(oak.camera, video=video))
    unit = tmp_path / "unit.json"
    write(unit, Calibration.nominal(half))
    frame = frame_of(half, tmp_path / "board.png", "board:500")
    square_mm = 18.0  # wrong on purpose: that is what a scale error looks like

    _, found = result_of(frame, "--calibration", unit, "--board", "chessboard:9x7", "--square-mm", square_mm)

    assert found["boards"] == 1
    assert abs(found["scale_error_percent"]) > 1
    assert found["advice"] != "fine"


def test_a_square_without_a_board_is_refused(unit: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--board"):
        run(tmp_path, "--calibration", unit, "--square-mm", 10)
