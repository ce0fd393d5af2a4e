"""From any scene to a rectification file, and from that to disparity: no board, no scale, no millimetres."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from host.command import complaint_of, result_of
from prismstereo.cli.from_scene import from_scene
from prismstereo.scene_disparity import ScenePipeline
from prismstereo_calibration.boards.detection import NamedFrame
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.uncalibrated.store import read
from prismstereo_hw import pfm
from prismstereo_hw.files import read_picture, write_picture
from prismstereo_hw.frame import RawFrame
from prismstereo_hw.kinds import AnyRig
from prismstereo_hw.rig import Mode, Rig
from prismstereo_hw.scene import named
from prismstereo_hw.twin import Twin


@pytest.fixture(scope="module")
def desk_rig() -> AnyRig:
    dslr = Rig.read("dslr-35mm")
    return msgspec.structs.replace(
        dslr, camera=msgspec.structs.replace(dslr.camera, video=Mode(width=480, height=270, rate_hz=30.0))
    )


@pytest.fixture(scope="module")
def desk(desk_rig: AnyRig) -> RawFrame:
    return Twin(desk_rig, named(desk_rig, "desk", 1)).frame()


@pytest.fixture(scope="module")
def unit(desk_rig: AnyRig, desk: RawFrame, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rectification file made of one frame of the desk."""
    path = tmp_path_factory.mktemp("unit") / "rectification.json"
    assert from_scene([NamedFrame("desk", desk.pixels)], desk_rig.views, desk_rig, path) == 0
    return path


def test_one_frame_of_any_scene_gives_a_file_and_its_figures(
    desk_rig: AnyRig, desk: RawFrame, unit: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wall = NamedFrame("wall", np.full_like(desk.pixels, 128))
    again = tmp_path / "again.json"
    frames = [NamedFrame("desk", desk.pixels), wall]
    assert from_scene(frames, desk_rig.views, desk_rig, again, as_json=True) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["form"] == "quasi-euclidean-5"
    assert result["row_error_mean_px"] <= 0.1
    assert result["forms"][0]["form"] == "quasi-euclidean-5"
    assert [entry["file"] for entry in result["frames_rejected"]] == ["wall"]
    assert result["unit"] is None
    assert again.read_bytes() == unit.read_bytes()  # the wall adds nothing


def test_depth_by_such_a_file_is_disparity_and_a_picture(desk: RawFrame, unit: Path, tmp_path: Path) -> None:
    frame = tmp_path / "desk.png"
    write_picture(frame, desk.pixels)
    out = tmp_path / "out"
    result = result_of("depth", frame, "--calibration", unit, "-o", out)
    assert sorted(path.name for path in out.iterdir()) == ["desk_disparity.pfm", "desk_disparity.png"]
    disparity = pfm.read_disparity(out / "desk_disparity.pfm")
    made = read(unit)
    assert disparity.shape == (made.height, made.width)
    assert result["frames"][0]["density"] >= 0.6
    assert result["unit"] is None
    assert read_picture(out / "desk_disparity.png").shape[0] == made.height
    refusal = complaint_of(2, "depth", frame, "--calibration", unit, "--range-mm", "400:inf", "-o", out)
    assert "has no scale, so there are no millimetres" in refusal


def test_a_frame_of_another_size_is_refused_by_name(unit: Path) -> None:
    with pytest.raises(CalibrationError, match="frame 0 is 320x180, but the rectification is for 480x270"):
        ScenePipeline(read(unit)).process(RawFrame(np.zeros((180, 320), np.uint8)))
