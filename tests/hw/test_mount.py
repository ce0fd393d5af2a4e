"""The committed mounts, judged without the CAD kernel: sound meshes, seats where the rig says, and no ray cut."""

from __future__ import annotations

import csv
import hashlib
import importlib.util
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from prismstereo_hw.kinds import PrismRig
from prismstereo_hw.optics.trace import trace
from prismstereo_hw.rig import Rig

MOUNT = Path(__file__).resolve().parents[2] / "hw" / "mount"
OUT = MOUNT / "out"
RIGS = ("dslr-35mm", "oak-1", "pi-camera-v2")
Array = NDArray[np.float64]


def read_stl(path: Path) -> Array:
    """Triangles (N, 3, 3) of a binary STL file."""
    raw = path.read_bytes()
    count = int.from_bytes(raw[80:84], "little")
    assert len(raw) == 84 + 50 * count, f"{path} is not a binary STL"
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])
    return np.frombuffer(raw, record, count, 84)["corners"].astype(np.float64)


def torn_edges(triangles: Array) -> int:
    """Number of directed edges that have no single partner in the other direction: 0 for a closed, oriented mesh."""
    corners, index = np.unique(np.round(triangles.reshape(-1, 3), 4), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    forwards, times = np.unique(begin * len(corners) + end, return_counts=True)
    backwards = np.unique(end * len(corners) + begin)
    return int((times != 1).sum()) + len(np.setxor1d(forwards, backwards))


def volume_mm3(triangles: Array) -> float:
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def cut(triangles: Array, start: Array, end: Array) -> NDArray[np.bool_]:
    """Which of the segments (N, 3) to (N, 3) meet any triangle (Moeller and Trumbore)."""
    low, high = np.minimum(start, end).min(axis=0), np.maximum(start, end).max(axis=0)
    near = ((triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high)).all(axis=1)
    met = np.zeros(len(start), bool)
    along = end - start
    for a, b, c in triangles[near]:
        first, second = b - a, c - a
        p = np.cross(along, second)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / (p @ first)
            offset = start - a
            u = np.einsum("ij,ij->i", offset, p) * scale
            q = np.cross(offset, first)
            v = np.einsum("ij,ij->i", along, q) * scale
            t = (q @ second) * scale
            met |= (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)  # parallel: NaN, no
    return met


def inside(triangles: Array, points: Array) -> NDArray[np.bool_]:
    """Which points (N, 3) lie in the solid: a slanted ray leaves it an odd number of times."""
    far = points + 500.0 * np.array([0.5123, -0.6611, 0.5481])
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    odd = np.zeros(len(points), bool)
    for number, (start, end) in enumerate(zip(points, far, strict=True)):
        p = np.cross(end - start, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / np.einsum("ij,ij->i", b - a, p)
            u = np.einsum("ij,ij->i", start - a, p) * scale
            q = np.cross(start - a, b - a)
            v = (q @ (end - start)) * scale
            t = np.einsum("ij,ij->i", c - a, q) * scale
            odd[number] = ((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).sum() % 2 == 1
    return odd


def pieces(triangles: Array) -> NDArray[np.int64]:
    """A number for each triangle (N,): the same for all that hang together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    corners, index = np.unique(np.round(triangles.reshape(-1, 3), 4), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    link = coo_array(
        (np.ones(2 * len(faces)), (np.repeat(faces[:, 0], 2), faces[:, 1:].ravel())), shape=(len(corners), len(corners))
    )
    _, label = connected_components(link, directed=False)
    return np.asarray(label[faces[:, 0]], np.int64)


def turned(points: Array, axis: Array, angle_deg: float) -> Array:
    """Points (..., 3) turned about an axis through the origin (Rodrigues)."""
    a = math.radians(angle_deg)
    across = np.cross(axis, points)
    return np.asarray(points + math.sin(a) * across + (1 - math.cos(a)) * np.cross(axis, across))


def light(rig: PrismRig, side: Any, count: int) -> tuple[Array, Array]:
    """Corner points (N, 5, 3) and last directions (N, 3) of rays that come through: any pixel, any point of the pupil."""
    rng = np.random.default_rng(7)
    mode = rig.camera.still
    pixels = rng.uniform(0, 1, (count, 2)) * [mode.width - 1, mode.height - 1]
    pixels[::4] = np.round(pixels[::4] / [mode.width, mode.height]) * [mode.width - 1, mode.height - 1]  # the corners
    pixels[1::4, 0] = np.round(pixels[1::4, 0] / mode.width) * (mode.width - 1)  # the outer columns
    slopes = rig.lens(mode).slopes(pixels)
    ahead = np.concatenate([slopes, np.ones((count, 1))], axis=1)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    turn = rng.uniform(0, 2 * np.pi, count)
    radius = rig.camera.pupil_diameter_mm / 2 * np.where(np.arange(count) % 2, 1.0, np.sqrt(rng.uniform(0, 1, count)))
    pupil = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(count)], axis=1)
    path = rig.surfaces(side)
    whole = trace(path, pupil, ahead)
    passes = whole.fate == 0
    points = [pupil, *(trace(path[:n], pupil, ahead).point_mm for n in range(1, len(path) + 1))]
    return np.stack(points, axis=1)[passes], whole.direction[passes]


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest) -> PrismRig:
    found = Rig.read(request.param)
    assert isinstance(found, PrismRig)
    return found


@pytest.fixture
def mesh(rig: PrismRig) -> Array:
    return read_stl(OUT / rig.name / "mount.stl")


@pytest.fixture
def record(rig: PrismRig) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((OUT / rig.name / "mount.json").read_text("utf-8"))
    return found


def test_the_record_belongs_to_the_rig_as_it_is_now(rig: PrismRig, record: dict[str, Any]) -> None:
    assert record["rig"] == rig.name
    assert record["rig_sha256"] == hashlib.sha256(rig.toml().encode()).hexdigest(), "run hw/mount/build.py --all"


def test_the_mesh_is_closed_and_as_large_as_the_kernel_says(mesh: Array, record: dict[str, Any]) -> None:
    assert torn_edges(mesh) == 0
    assert volume_mm3(mesh) == pytest.approx(record["volume_mm3"], rel=0.005)
    np.testing.assert_allclose([mesh.min((0, 1)), mesh.max((0, 1))], record["bbox_mm"], atol=0.05)


def test_a_mesh_with_a_hole_or_a_turned_triangle_is_noticed(mesh: Array) -> None:
    turned = mesh.copy()
    turned[5] = turned[5, ::-1]
    assert torn_edges(mesh[1:]) > 0
    assert torn_edges(turned) > 0


def test_no_ray_of_either_view_is_cut(rig: PrismRig, mesh: Array) -> None:
    for side in ("left", "right"):
        points, direction = light(rig, side, 4000)
        assert len(points) > 1000
        path = np.concatenate([points, points[:, -1:] + 400.0 * direction[:, None]], axis=1)
        for number in range(5):
            assert not cut(mesh, path[:, number], path[:, number + 1]).any(), f"{side} view, part {number} of the way"


def test_a_mount_pushed_into_the_light_is_noticed(rig: PrismRig, mesh: Array) -> None:
    points, direction = light(rig, "right", 1000)
    raised = mesh - [0.0, 20.0, 0.0]  # the base plate comes up into the way out
    assert cut(raised, points[:, 4], points[:, 4] + 400.0 * direction).any()
    closed = mesh - [-8.0, 0.0, 0.0]  # the bore goes to the side
    assert cut(closed, points[:, 0], points[:, 1]).any()


def test_the_seats_hold_prism_and_mirrors_where_the_rig_says(rig: PrismRig, record: dict[str, Any]) -> None:
    base, face, exit_face, mirror = rig.surfaces("right")
    left_mirror = rig.surfaces("left")[3]
    ahead = np.array([0.0, 0.0, 1.0])
    expected = {  # a point of the optical surface, and the direction in which its seat looks
        "prism base": (base.centre_mm, ahead),
        "prism end": (base.centre_mm - [0, -rig.prism.length_mm / 2, 0], np.array([0.0, -1.0, 0.0])),
        "prism left face": (face.centre_mm, np.array([math.cos(math.pi / 6), 0, -0.5])),
        "prism right face": (exit_face.centre_mm, np.array([-math.cos(math.pi / 6), 0, -0.5])),
        "left mirror": (left_mirror.centre_mm, left_mirror.normal * np.sign(left_mirror.normal[2])),
        "right mirror": (mirror.centre_mm, mirror.normal * np.sign(mirror.normal[2])),
    }
    assert set(record["seats"]) == set(expected)
    for name, (point, normal) in expected.items():
        seat = record["seats"][name]
        np.testing.assert_allclose(seat["normal"], normal, atol=1e-6, err_msg=name)
        gap = float((point - np.array(seat["origin_mm"])) @ normal)  # from the printed seat to the glass surface
        assert gap == pytest.approx(seat["clearance_mm"], abs=0.01), name


def test_the_mesh_has_the_seats_of_the_record(mesh: Array, record: dict[str, Any]) -> None:
    normals = np.cross(mesh[:, 1] - mesh[:, 0], mesh[:, 2] - mesh[:, 0])
    area = np.linalg.norm(normals, axis=1)
    for name, seat in record["seats"].items():
        level = (mesh - seat["origin_mm"]) @ np.array(seat["normal"])
        same = (np.abs(level).max(axis=1) < 0.01) & (normals @ np.array(seat["normal"]) > 0.9999 * area)
        assert area[same].sum() / 2 > 20.0, f"{name}: no printed face of 20 mm2 where the record has one"


def test_every_hole_is_there_with_its_diameter(mesh: Array, record: dict[str, Any]) -> None:
    assert len(record["holes"]) >= 24
    turn = np.radians([45.0, 165.0, 285.0])
    for hole in record["holes"]:
        axis = np.array(hole["axis"])
        middle = np.array(hole["start_mm"]) + axis * min(hole["depth_mm"] / 2, 1.6)
        first = np.cross(axis, [0.3, 0.5, 0.8])
        first /= np.linalg.norm(first)
        ring = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(axis, first)
        radius = hole["diameter_mm"] / 2
        assert not inside(mesh, middle + (radius - 0.1) * ring).any(), hole["purpose"]
        assert inside(mesh, middle + (radius + 0.1) * ring).all(), hole["purpose"]


def test_over_its_whole_travel_a_carrier_strikes_nothing(mesh: Array, record: dict[str, Any]) -> None:
    seat = record["seats"]["right mirror"]
    normal = np.array(seat["normal"])
    hinges = {"vergence": np.array([0.0, 1.0, 0.0]), "tip": np.array([normal[2], 0.0, -normal[0]])}
    pivot = np.array(next(h["start_mm"] for h in record["holes"] if h["purpose"].startswith("right mirror, pivot")))
    piece = pieces(mesh)
    on_pads = np.abs((mesh - seat["origin_mm"]) @ normal).max(axis=1) < 0.01
    carrier = mesh[piece == np.bincount(piece[on_pads]).argmax()]
    rest = mesh[piece != np.bincount(piece[on_pads]).argmax()]
    rest = rest[np.linalg.norm(rest - pivot, axis=2).min(axis=1) > 6.0]  # the pivot's cone is meant to touch
    for name, axis in hinges.items():
        for sense in (-1.0, 1.0):
            moved = turned(carrier - pivot, axis, sense * record["mirror_travel_deg"][name]) + pivot
            ends = np.roll(moved, -1, axis=1)
            assert not cut(rest, moved.reshape(-1, 3), ends.reshape(-1, 3)).any(), name


def test_the_adjusters_reach_farther_than_printing_errs(record: dict[str, Any]) -> None:
    for name in ("tip", "vergence"):
        assert record["mirror_travel_deg"][name] > 1.5
        assert record["adjuster_deg_per_turn"][name] < 1.0


@pytest.mark.parametrize("path", sorted(OUT.glob("*/print/*.stl")) + sorted(OUT.glob("rings/*.stl")), ids=str)
def test_every_printable_part_is_closed_and_lies_on_the_bed(path: Path) -> None:
    triangles = read_stl(path)
    assert torn_edges(triangles) == 0
    assert volume_mm3(triangles) > 1000
    assert triangles[..., 2].min() == pytest.approx(0.0, abs=1e-3)
    assert path.stat().st_size < 1.5e6


@pytest.mark.parametrize(
    ("name", "major_mm", "pitch_mm"),
    [("lens-M49", 49.0, 0.75), ("lens-M52", 52.0, 0.75), ("lens-M58", 58.0, 0.75), ("c-mount", 25.4, 25.4 / 32)],
)
def test_a_ring_has_a_right_handed_thread_of_its_pitch(name: str, major_mm: float, pitch_mm: float) -> None:
    corners = read_stl(OUT / "rings" / f"{name}.stl").reshape(-1, 3)
    corners = corners[corners[:, 2] > 3.1]  # above the flange
    radius = np.hypot(corners[:, 0], corners[:, 1])
    assert major_mm / 2 - 0.2 < radius.max() < major_mm / 2 - 0.1  # a little small, as printed threads grow
    crest = corners[radius > radius.max() - 0.02]
    turn = np.arctan2(crest[:, 1], crest[:, 0]) / (2 * np.pi)
    phase = np.exp(2j * np.pi * (crest[:, 2] / pitch_mm - turn))  # constant along a right-handed helix
    assert abs(phase.mean()) > 0.9
    assert abs((phase * np.exp(4j * np.pi * turn)).mean()) < 0.5  # and not along a left-handed one
    assert np.ptp(crest[:, 2]) > 2.4 * pitch_mm


def test_the_plate_drawing_has_the_holes_of_the_record(rig: PrismRig, record: dict[str, Any]) -> None:
    lines = [line.strip() for line in (OUT / rig.name / "plate.dxf").read_text("utf-8").splitlines()]
    found = set()
    for start in (number for number, line in enumerate(lines) if line == "CIRCLE"):
        tags = dict(zip(lines[start + 1 : start + 21 : 2], lines[start + 2 : start + 22 : 2], strict=True))
        found.add(tuple(round(float(tags[code]), 2) for code in ("10", "20", "40")))
    feet = {
        (round(hole["start_mm"][0], 2), round(hole["start_mm"][2], 2), round(hole["diameter_mm"] / 2, 2))
        for hole in record["holes"]
        if abs(hole["axis"][1]) > 0.999 and hole["part"] == "body" and "insert" not in hole["purpose"]
    }
    assert len(feet) == 5
    assert found == feet


def test_the_drawing_says_the_numbers_of_the_rig(rig: PrismRig) -> None:
    drawing = (OUT / rig.name / "drawing.svg").read_text("utf-8")
    mirrors = rig.mirrors
    for words in (
        f">{rig.prism.pupil_to_prism_mm:.1f}<",
        f">{mirrors.offset_mm:.1f}<",
        f"= {2 * mirrors.near_edge_mm:.1f}<",
        f">mirror {mirrors.length_mm:.1f}<",
        f">{mirrors.angle_deg:.2f}°",
        f"mount for {rig.name}<",
    ):
        assert words in drawing


def test_the_three_rigs_have_all_their_files(rig: PrismRig) -> None:
    folder = OUT / rig.name
    for name in ("mount.step", "mount.stl", "mount.json", "plate.dxf", "drawing.svg"):
        assert 1000 < (folder / name).stat().st_size < 1.5e6, name
    assert (folder / "drawing.svg").read_text("utf-8").count("<text") > 20
    assert (folder / "mount.step").read_text("utf-8").startswith("ISO-10303-21")
    printed = {path.stem for path in (folder / "print").glob("*.stl")}
    assert printed == {"body", "bracket", "clamp", "carrier-left", "carrier-right"}


def test_the_bill_of_materials_adds_up() -> None:
    with (MOUNT / "bill-of-materials.csv").open(encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    assert {"part", "quantity", "size", "cost_eur", "note"} <= set(rows[0])
    assert all(int(row["quantity"]) > 0 and float(row["cost_eur"]) >= 0 for row in rows)
    screws = sum(int(row["quantity"]) for row in rows if row["part"].startswith("M3x16 socket"))
    assert screws == 6  # three to a mirror


@pytest.mark.skipif(importlib.util.find_spec("build123d") is None, reason="build123d (extra `cad`) is not installed")
def test_a_rebuild_gives_the_committed_mount(rig: PrismRig, record: dict[str, Any], tmp_path: Path) -> None:
    command = [sys.executable, str(MOUNT / "build.py"), rig.name, "-o", str(tmp_path)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    again = json.loads((tmp_path / "mount.json").read_text("utf-8"))
    assert again["volume_mm3"] == pytest.approx(record["volume_mm3"], rel=1e-6)
    np.testing.assert_allclose(again["bbox_mm"], record["bbox_mm"], atol=1e-3)
    assert again["holes"] == record["holes"]
    assert torn_edges(read_stl(tmp_path / "mount.stl")) == 0
