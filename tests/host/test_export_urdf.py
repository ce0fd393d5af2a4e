from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo.export.ros_messages import FrameNames
from prismstereo.export.urdf import committed_mount, placing, write_urdf
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import Rectification
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.optics.sight import sight
from prismstereo_hw.rig import Rig

NAMES = FrameNames("eye")
BODY_FROM_OPTICAL = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def _pose(element: ET.Element) -> NDArray[np.float64]:
    """The 4 x 4 matrix of an <origin>, by the textbook: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = (float(value) for value in element.attrib["rpy"].split())
    turns = []
    for angle, (i, j) in ((yaw, (0, 1)), (-pitch, (0, 2)), (roll, (1, 2))):
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
        turns.append(turn)
    pose = np.eye(4)
    pose[:3, :3] = turns[0] @ turns[1] @ turns[2]
    pose[:3, 3] = [float(value) for value in element.attrib["xyz"].split()]
    return pose


def _joints(robot: ET.Element) -> dict[str, NDArray[np.float64]]:
    found = {}
    for joint in robot.findall("joint"):
        parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
        assert parent is not None
        assert child is not None
        assert origin is not None
        assert (parent.attrib["link"], joint.attrib["type"]) == ("eye_link", "fixed")
        found[child.attrib["link"]] = _pose(origin)
    return found


def test_the_left_optical_frame_stands_in_the_mount_where_the_rig_has_its_virtual_pinhole(
    rig: Rig, rectified: Rectification, pinhole_z_mm: float, tmp_path: Path
) -> None:
    write_urdf(tmp_path, placing(rig), names=NAMES, mesh=committed_mount(rig.name))

    joints = _joints(ET.parse(tmp_path / "eye.urdf").getroot())

    mount, left, right = (joints[f"eye_{name}"] for name in ("mount", "left_optical_frame", "right_optical_frame"))
    rig_from_left = np.linalg.inv(mount) @ left  # in the mount's body axes
    virtual = BODY_FROM_OPTICAL.T @ (1000 * rig_from_left[:3, 3])
    assert virtual[2] == pytest.approx(pinhole_z_mm, abs=1e-3)
    assert virtual[0] == pytest.approx(sight(rig, "left").centre_mm[0], abs=0.5)
    ahead = rig_from_left[:3, :3] @ [0, 0, 1]
    np.testing.assert_allclose(ahead, [1, 0, 0], atol=1e-9)  # both views together look along the rig's axis
    apart = np.linalg.inv(left) @ right
    baseline_m = rectified.window.scale_px / rectified.focal_px / 1000
    np.testing.assert_allclose(apart[:3, 3], [baseline_m, 0, 0], atol=1e-9)
    np.testing.assert_allclose(apart[:3, :3], np.eye(3), atol=1e-9)


def test_the_mesh_lies_in_the_mount_as_the_rig_file_has_it(oak: Rig, tmp_path: Path) -> None:
    paths = write_urdf(tmp_path, placing(oak), names=NAMES, mesh=committed_mount("oak-1"))

    assert [path.relative_to(tmp_path).as_posix() for path in paths] == ["meshes/mount.stl", "eye.urdf"]
    robot = ET.parse(paths[1]).getroot()
    mesh, origin = robot.find(".//visual/geometry/mesh"), robot.find(".//visual/origin")
    assert mesh is not None
    assert origin is not None
    assert (tmp_path / mesh.attrib["filename"]).is_file()
    assert mesh.attrib["scale"] == "0.001 0.001 0.001"
    np.testing.assert_allclose(_pose(origin)[:3, :3], BODY_FROM_OPTICAL, atol=1e-8)
    box, centre = robot.find(".//collision/geometry/box"), robot.find(".//collision/origin")
    assert box is not None
    assert centre is not None
    # bbox_mm of mount.json: x -71.65..71.65, y -38..34.5, z -29.8..58.6995
    np.testing.assert_allclose(np.fromstring(box.attrib["size"], sep=" "), [0.0885, 0.1433, 0.0725], atol=1e-4)
    np.testing.assert_allclose(_pose(centre)[:3, 3], [0.01445, 0, 0.00175], atol=1e-5)


def test_a_rig_without_a_mesh_is_described_without_one(oak: Rig, tmp_path: Path) -> None:
    paths = write_urdf(tmp_path, placing(oak), names=NAMES, mesh=None)

    assert [path.name for path in paths] == ["eye.urdf"]
    assert ET.parse(paths[0]).getroot().find(".//visual") is None
    assert committed_mount("biprism") is None


def test_a_mesh_that_is_none_and_a_calibration_of_another_rig_are_refused(oak: Rig, dslr: Rig, tmp_path: Path) -> None:
    (tmp_path / "mount.stl").write_bytes(b"solid text" * 20)

    with pytest.raises(DataError, match="not a binary STL"):
        write_urdf(tmp_path, placing(oak), names=NAMES, mesh=tmp_path / "mount.stl")
    with pytest.raises(UsageError, match="needs one of that rig"):
        placing(oak, Calibration.nominal(dslr))
