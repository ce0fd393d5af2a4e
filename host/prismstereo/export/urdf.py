"""The sensor as a robot description: a folder with a URDF file and the mount's mesh.

Frames, all fixed (REP 103): `*_link`, a body frame in the left virtual camera, from which distances are counted, is the root;
`*_mount`, a body frame in the real lens' entrance pupil, carries the mesh; the two optical frames stand where the rig file
puts them, or a calibration. Where a node publishes measured transforms as well, let it not: both would tell of the same frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

import prismstereo_hw
from prismstereo.export.ros_messages import FrameNames
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_hw.errors import DataError, UsageError
from prismstereo_hw.files import write_whole
from prismstereo_hw.optics.sight import sight
from prismstereo_hw.rig import Rig

__all__ = ["MESH", "Placing", "committed_mount", "placing", "write_urdf"]

Array = NDArray[np.float64]
MESH = "mount.stl"
_MM = 1e-3
_HEADER_BYTES, _FACET_BYTES = 84, 50
_MOST_BYTES = 64 << 20
_OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # a body's axes in optical ones
_OPTICAL_RPY = (-math.pi / 2, 0.0, -math.pi / 2)


@dataclass(frozen=True, slots=True)
class Placing:
    """How the mount stands in the body frame of the left view: `R_link_from_mount` (3, 3), `at_m` (3,); and the baseline."""

    R_link_from_mount: Array
    at_m: Array
    baseline_m: float


def placing(rig: Rig, calibration: Calibration | None = None) -> Placing:
    """Place a rig's parts; by its own promise, or by a calibration of it, which is what a unit really is.

    A calibration knows no rig frame, so its left camera stands where the rig file puts it. UsageError where it is of another
    rig, or without millimetres.
    """
    known = Calibration.nominal(rig) if calibration is None else calibration
    if known.rig != rig.name or known.unit != "mm":
        raise UsageError(
            f"a calibration of {known.rig!r} in {known.unit}: a description of {rig.name!r} needs one of that rig, in mm"
        )
    made = rectification(known)
    left = made.left
    view = sight(rig, "left")
    R_rectified_from_rig = left.R_rectified_from_left @ view.R
    origin_mm = view.centre_mm + left.pinhole @ view.R
    link_from_optical = _OPTICAL_FROM_BODY.T
    turn = link_from_optical @ R_rectified_from_rig @ _OPTICAL_FROM_BODY
    at_m = link_from_optical @ (R_rectified_from_rig @ -origin_mm) * _MM
    return Placing(turn, at_m, made.window.scale_px / made.focal_px * _MM)


def committed_mount(rig: str) -> Path | None:
    """Find the mesh of a built-in rig's mount in this checkout; None where there is none."""
    path = Path(prismstereo_hw.__file__).resolve().parents[1] / "mount" / "out" / rig / MESH
    return path if path.is_file() else None


def write_urdf(folder: Path, placed: Placing, *, names: FrameNames, mesh: Path | None) -> list[Path]:
    """Write SENSOR.urdf of a sensor and, of a mesh in mm of the rig frame (binary STL), meshes/mount.stl; return their paths.

    No masses are given: a printed mount's depends on its filling. DataError for a mesh that is none.
    """
    robot = ET.Element("robot", name=names.sensor)
    robot.append(ET.Element("link", name=names.link))
    mount = ET.SubElement(robot, "link", name=names.mount)
    paths: list[Path] = []
    if mesh is not None:
        content = _read_stl(mesh)
        paths.append(folder / "meshes" / MESH)
        write_whole(paths[0], content)
        _add_shapes(mount, content, names)
    _add_joint(robot, names.link, names.mount, placed.at_m, _rpy(placed.R_link_from_mount))
    right = np.array([0.0, -placed.baseline_m, 0.0])
    for child, at_m in ((names.left, np.zeros(3)), (names.right, right)):
        robot.append(ET.Element("link", name=child))
        _add_joint(robot, names.link, child, at_m, _OPTICAL_RPY)
    ET.indent(robot)
    note = (
        "<!-- made by prismstereo; metres, radians -->\n"  # a comment may hold no two dashes, and so no option of ours
    )
    text = '<?xml version="1.0"?>\n' + note + ET.tostring(robot, encoding="unicode") + "\n"
    paths.append(folder / f"{names.sensor}.urdf")
    write_whole(paths[-1], text.encode())
    return paths


def _read_stl(path: Path) -> bytes:
    try:
        content = path.read_bytes() if path.stat().st_size <= _MOST_BYTES else b""
    except OSError as error:
        raise DataError(f"cannot read the mesh {path}: {error.strerror}") from error
    facets = int.from_bytes(content[_HEADER_BYTES - 4 : _HEADER_BYTES], "little")
    if len(content) < _HEADER_BYTES + _FACET_BYTES or len(content) != _HEADER_BYTES + _FACET_BYTES * facets:
        raise DataError(
            f"{path} is not a binary STL file of one facet or more, up to 64 MB: make it with hw/mount/build.py"
        )
    return content


def _bounds_m(stl: bytes) -> tuple[Array, Array]:
    """Return the lower and the upper corner of a mesh's box in the mount's body frame."""
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(stl, facet, offset=_HEADER_BYTES)["corners"].reshape(-1, 3).astype(float)
    body = corners @ _OPTICAL_FROM_BODY * _MM
    return body.min(axis=0), body.max(axis=0)


def _add_shapes(link: ET.Element, stl: bytes, names: FrameNames) -> None:
    """Show the mesh, and let a box of its size be what things bump into."""
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz="0 0 0", rpy=_numbers(_OPTICAL_RPY))
    shape = ET.SubElement(visual, "geometry")
    ET.SubElement(shape, "mesh", filename=f"meshes/{MESH}", scale=_numbers([_MM] * 3))
    material = ET.SubElement(visual, "material", name=f"{names.sensor}_print")
    ET.SubElement(material, "color", rgba="0.2 0.2 0.22 1")
    low, high = _bounds_m(stl)
    collision = ET.SubElement(link, "collision")
    ET.SubElement(collision, "origin", xyz=_numbers((low + high) / 2), rpy="0 0 0")
    ET.SubElement(ET.SubElement(collision, "geometry"), "box", size=_numbers(high - low))


def _add_joint(robot: ET.Element, parent: str, child: str, at_m: Array, rpy: tuple[float, float, float]) -> None:
    joint = ET.SubElement(robot, "joint", name=f"{child}_joint", type="fixed")
    ET.SubElement(joint, "origin", xyz=_numbers(at_m), rpy=_numbers(rpy))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)


def _numbers(values: Array | list[float] | tuple[float, ...]) -> str:
    return " ".join(f"{float(value) + 0.0:.12g}" for value in values)


def _rpy(R: Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a rotation: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = math.asin(min(1.0, max(-1.0, -R[2, 0])))
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])
