from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from host.command import in_process
from prismstereo.cli.export import command
from prismstereo_calibration import store
from prismstereo_calibration.model import Calibration
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.session import SessionWriter
from prismstereo_hw.twin import Twin


@pytest.fixture(scope="module")
def session(small: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of a wall at 800 mm."""
    folder = tmp_path_factory.mktemp("export") / "session"
    twin = Twin(small, facing_plane(small, 800.0), noise=0.0)
    writer = SessionWriter(folder, small, "wall")
    for index in range(2):
        writer.add("video", twin.frame(index))
    store.write(folder / "calibration.json", Calibration.nominal(small))
    writer.finish()
    return folder


def test_a_session_is_exported_frame_by_frame_at_its_walls_distance(session: Path, tmp_path: Path) -> None:
    code, printed = in_process(command, session, "--to", "ply", "--frames", "1:9", "-o", tmp_path / "clouds", "--json")

    result = json.loads(printed)
    assert (code, result["format"], result["frames"]) == (0, "ply", 1)
    assert [Path(file).name for file in result["files"]] == ["000001.ply"]
    content = (tmp_path / "clouds" / "000001.ply").read_bytes()
    head, _, body = content.partition(b"end_header\n")
    assert b"comment unit mm" in head
    rows = np.frombuffer(body, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "u1", 3)])
    assert result["points"] == len(rows) > 5000
    assert np.median(rows["z"]) == pytest.approx(813, abs=6)  # the virtual pinholes stand behind the entrance pupil


def test_a_mesh_goes_into_one_file_of_that_name(session: Path, tmp_path: Path) -> None:
    code, printed = in_process(command, session, "--to", "glb", "--mesh", "--frames", ":1", "-o", tmp_path / "wall.glb")

    assert code == 0
    assert printed.startswith("wrote 1 frames, ")
    assert (tmp_path / "wall.glb").read_bytes()[:4] == b"glTF"


def test_a_robot_description_needs_no_source(tmp_path: Path) -> None:
    code, printed = in_process(command, "--to", "urdf", "--rig", "oak-1", "--name", "eye", "-o", tmp_path, "--json")

    assert code == 0
    assert json.loads(printed)["mesh"]
    assert "eye_left_optical_frame" in (tmp_path / "eye.urdf").read_text()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--to", "ply"], "needs a SOURCE"),
        (["nowhere", "--to", "ply"], "neither a session folder nor a recording"),
        (["{session}", "--to", "ply", "--frames", "2:2"], "B is not included"),
        (["{session}", "--to", "ply", "--frames", "-1:2"], "whole numbers from 0"),
        (["{session}", "--to", "ply", "--rig", "oak-1"], "go with --to urdf"),
        (["{session}", "--to", "urdf", "--rig", "oak-1"], "no SOURCE"),
        (["{session}", "--to", "ros2", "--name", "My Eye"], "small letters"),
        (["{session}/session.toml", "--to", "ply", "--matcher", "tiles"], "prismstereo replay"),
    ],
)
def test_a_wish_that_cannot_be_granted_is_refused_by_name(
    session: Path, tmp_path: Path, arguments: list[str], complaint: str
) -> None:
    asked = [argument.format(session=session) for argument in arguments]

    with pytest.raises(UsageError, match=complaint):
        in_process(command, *asked, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()
