from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from host.export_frames import UNMATCHED, WALL_MM, flat_calibration, frame_of, painted, pinhole_points_m, wall
from host.glb_rules import Broken, checked
from prismstereo.export.formats import Wishes, export
from prismstereo.export.glb import mesh_glb, points_glb
from prismstereo.export.grid_mesh import grid_mesh
from prismstereo_calibration.model import Calibration
from prismstereo_calibration.rectification import rectification
from prismstereo_hw.rig import Rig

OPENGL = np.array([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def flat(small: Rig) -> Calibration:
    return flat_calibration(small)


def test_points_stand_in_metres_with_y_up_and_keep_their_colours(flat: Calibration) -> None:
    made = rectification(flat)
    cloud = frame_of(flat).cloud(1e-3)

    found = checked(points_glb(cloud.points, cloud.colours))

    positions = found.attribute("POSITION")
    np.testing.assert_allclose(positions, pinhole_points_m(flat, wall(made)) * OPENGL, rtol=2e-6, atol=1e-7)
    np.testing.assert_allclose(positions[:, 2], -WALL_MM / 1000, rtol=2e-6)
    assert found.primitive["mode"] == 0
    linear = found.attribute("COLOR_0")[:, :3] / 65535
    shown = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.rint(255 * shown), painted(made)[20:].reshape(-1, 3)[:, ::-1])


def test_a_mesh_covers_the_wall_and_no_triangle_spans_a_jump_in_depth(flat: Calibration) -> None:
    made = rectification(flat)
    depth = wall(made)
    depth[:, 80:] = 1.5 * WALL_MM  # a step: 400 mm behind
    depth[UNMATCHED] = np.nan
    frame = frame_of(flat, depth)

    found = checked(mesh_glb(grid_mesh(frame, 0.05), frame.left))

    rows, columns = made.height - 20, made.width
    triangles = found.accessor(found.primitive["indices"]).reshape(-1, 3)
    assert len(triangles) == 2 * (rows - 1) * (columns - 2)  # one column of squares is left out
    corners = found.attribute("POSITION")[triangles]
    assert np.ptp(corners[..., 2], axis=1).max() < 1e-6
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (facing[:, 2] > 0).all()  # counter-clockwise for the camera, which looks along -z


def test_a_mesh_wears_the_picture_pixel_by_pixel(flat: Calibration) -> None:
    made = rectification(flat)
    frame = frame_of(flat)

    found = checked(mesh_glb(grid_mesh(frame), frame.left))

    uv = found.attribute("TEXCOORD_0") * [made.width, made.height] - 0.5
    position = found.attribute("POSITION")
    seen = position / -position[:, 2:] * OPENGL * made.focal_px + [made.left.cx_px, made.cy_px, 0]
    np.testing.assert_allclose(uv, seen[:, :2], atol=1e-3)
    assert found.texture().shape == painted(made).shape
    difference = np.abs(found.texture().astype(int) - painted(made).astype(int))
    assert np.median(difference) <= 6  # JPEG


def test_a_frame_without_a_match_is_an_empty_scene(flat: Calibration) -> None:
    nothing = frame_of(flat, np.full_like(wall(rectification(flat)), np.nan))

    for content in (points_glb(nothing.cloud().points), mesh_glb(grid_mesh(nothing))):
        assert "meshes" not in checked(content).json


def test_a_mesh_without_a_picture_has_no_texture(flat: Calibration) -> None:
    frame = frame_of(flat, picture=False)

    found = checked(mesh_glb(grid_mesh(frame), frame.left))

    assert "images" not in found.json
    assert set(found.primitive["attributes"]) == {"POSITION"}


def _altered(content: bytes, change: str) -> bytes:
    """Break one rule: in the JSON, where `change` is run on it, or in the bytes."""
    size = struct.unpack_from("<I", content, 12)[0]
    gltf = json.loads(content[20 : 20 + size])
    exec(change, {"gltf": gltf})  # of the list below
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + size :]
    return struct.pack("<IIIII", 0x46546C67, 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ("gltf['asset']['version'] = '1.0'", "asset.version"),
        ("gltf['bufferViews'][0]['byteOffset'] = 2", "aligned"),
        ("gltf['bufferViews'][0]['byteLength'] += 10**9", "inside its buffer"),
        ("gltf['accessors'][0]['count'] += 1", "inside its view"),
        ("gltf['accessors'][0]['max'][2] = 0.0", "max is that of the values"),
        ("del gltf['accessors'][0]['min']", "says its box"),
        ("gltf['accessors'][1]['count'] -= 1", "one count"),
        ("gltf['bufferViews'][0]['target'] = 34963", "vertices' target"),
        ("gltf['buffers'][0]['byteLength'] -= 8", "inside its buffer|longer than its buffer"),
        ("gltf['extensionsUsed'] = []", "extensions"),
        ("gltf['accessors'][gltf['meshes'][0]['primitives'][0]['indices']]['count'] -= 1", "three corners"),
    ],
)
def test_the_checker_of_these_tests_finds_broken_rules(flat: Calibration, change: str, rule: str) -> None:
    frame = frame_of(flat)
    content = mesh_glb(grid_mesh(frame), frame.left)
    checked(content)

    with pytest.raises(Broken, match=rule):
        checked(_altered(content, change))


def test_trimesh_reads_points_and_mesh_back(flat: Calibration, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="independent reader of GLB and PLY: pip install trimesh")
    frame = frame_of(flat)
    export("glb", tmp_path / "mesh.glb", [frame], Wishes(mesh=True))
    export("ply", tmp_path / "cloud.ply", [frame], Wishes())

    mesh = trimesh.load(tmp_path / "mesh.glb", force="mesh")
    cloud = trimesh.load(tmp_path / "cloud.ply")

    points = pinhole_points_m(flat, wall(rectification(flat)))
    np.testing.assert_allclose(mesh.bounds[:, 2], -WALL_MM / 1000, rtol=2e-6)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0)[:2], np.ptp(points, axis=0)[:2], rtol=1e-5)
    np.testing.assert_allclose(cloud.vertices, 1000 * points, rtol=2e-6, atol=1e-4)
