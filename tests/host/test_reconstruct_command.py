from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import msgspec
import pytest
import trimesh

from host.command import in_process
from host.glb_rules import checked
from prismstereo.cli.reconstruct import command
from prismstereo_calibration.errors import CalibrationError
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.store import write
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.files import write_picture
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import facing_plane
from prismstereo_hw.session import SessionWriter
from prismstereo_hw.twin import Twin

WALL_MM = 900.0


@pytest.fixture(scope="module")
def session(small: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of a wall before a small rig."""
    folder = tmp_path_factory.mktemp("sessions") / "wall"
    twin = Twin(small, facing_plane(small, WALL_MM), noise=1.0)
    writer = SessionWriter(folder, small, "plane:900", standing=twin.standing)
    for index in range(2):
        writer.add("video", twin.frame(index))
    write(folder / "calibration.json", Calibration.nominal(small))
    writer.finish()
    return folder


def test_every_frame_becomes_files_that_others_read(session: Path, tmp_path: Path) -> None:
    out = tmp_path / "meshes"
    code, printed = in_process(command, session, "-o", out, "--format", "ply", "--format", "glb", "--preview", "--json")
    told = json.loads(printed)
    assert code == 0
    assert {path.name for path in out.iterdir()} == {
        "000000.ply", "000000.glb", "000001.ply", "000001.glb", "meshes.json", "preview.mp4"
    }  # fmt: skip
    listed = msgspec.json.decode((out / "meshes.json").read_bytes())
    assert (listed["schema"], listed["unit"]) == ("prismstereo-meshes/1", "mm")
    for index, one in enumerate(told["frames"]):
        ply = trimesh.load(out / f"{index:06d}.ply", process=False)
        assert (len(ply.vertices), len(ply.faces)) == (one["vertices"], one["triangles"])
        glb = checked((out / f"{index:06d}.glb").read_bytes())
        assert glb.attribute("POSITION")[:, 2].mean() == pytest.approx(-1e-3 * ply.vertices[:, 2].mean(), rel=1e-5)
        assert 0 < one["median_sigma"] < 60
    film = cv2.VideoCapture(str(out / "preview.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 2
    film.release()


def test_a_part_of_the_frames_the_picture_and_the_range(session: Path, tmp_path: Path) -> None:
    told = json.loads(
        in_process(
            command, session, "-o", tmp_path, "--first", 1, "--frames", 1, "--roi", "40,30,60,50", "--holes", "none",
            "--memory", 1, "--json",
        )[1]
    )  # fmt: skip
    assert [one["frame"] for one in told["frames"]] == [1]
    assert 0 < told["frames"][0]["vertices"] <= 60 * 50
    assert told["frames"][0]["filled_pixels"] == 0


def test_no_mesh_at_all_is_one_clear_error_and_leaves_nothing(session: Path, tmp_path: Path) -> None:
    out = tmp_path / "meshes"
    with pytest.raises(DataError, match="no mesh in any"):
        in_process(command, session, "-o", out, "--gate-mm", "100:110", "--preview")
    assert not out.exists() or not list(out.iterdir())
    with pytest.raises(DataError, match="0 frames"):
        in_process(command, session, "-o", out, "--first", 7)


def test_wrong_wishes_say_how_they_are_meant(session: Path, tmp_path: Path) -> None:
    for wish, words in (
        (("--roi", "1,2,3"), "X,Y,WIDTH,HEIGHT"),
        (("--roi", "0,0,9999,10"), "reaches out"),
        (("--gate-mm", "far"), "A:Z"),
    ):
        with pytest.raises(UsageError, match=words):
            in_process(command, session, "-o", tmp_path / "meshes", *wish)


def test_a_calibration_of_another_rig_is_refused(session: Path, dslr: Rig, tmp_path: Path) -> None:
    write(tmp_path / "other.json", Calibration.nominal(dslr))
    with pytest.raises(CalibrationError, match="calibration of"):
        in_process(command, session, "-o", tmp_path / "meshes", "--calibration", tmp_path / "other.json")


def test_a_frame_of_one_pixel_is_one_clear_error(session: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(session, broken)
    picture = cv2.imread(str(broken / "video" / "000000.png"))
    write_picture(broken / "video" / "000000.png", picture[:1, :1])
    with pytest.raises(CalibrationError, match="1x1"):
        in_process(command, broken, "-o", tmp_path / "meshes")
