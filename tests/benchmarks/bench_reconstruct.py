"""From a disparity map of 640x720 to a mesh with normals and sigmas, beside vertex normals alone by trimesh; and its file."""

from __future__ import annotations

import numpy as np
import trimesh

from benchmarks.row import BenchRow, interleave
from prismstereo.export.frames import ExportFrame
from prismstereo.export.geometry import Geometries
from prismstereo.reconstruction import Steady, Surface, fill_small_holes, mesh_of
from prismstereo.reconstruction.mesh_ply import mesh_ply
from prismstereo_calibration.model import Calibration
from prismstereo_device.pipeline import Pipeline
from prismstereo_hw.rig import Rig
from prismstereo_hw.scene import desk
from prismstereo_hw.twin import Twin


def measure() -> list[BenchRow]:
    rig = Rig.read("oak-1")
    calibration = Calibration.nominal(rig)
    pipeline = Pipeline(calibration)
    pair = pipeline.split(Twin(rig, desk(rig), noise=1.5).frame())
    left = pipeline.rectifier.left_picture(pair)
    frame = ExportFrame.of(0, 0, pipeline.disparity(pair), left, Geometries(calibration))
    surface = Surface.of(frame)
    mesh = mesh_of(surface)
    points, triangles = mesh.points.astype(np.float64), mesh.triangles.astype(np.int64)
    steady = Steady()
    steady.next(surface)

    def peer() -> object:
        return trimesh.Trimesh(points, triangles, process=False, validate=False).vertex_normals

    def exported() -> object:
        return trimesh.Trimesh(points, triangles, process=False, validate=False).export(file_type="ply")

    works = {
        "surface and mesh, 640x720": lambda: mesh_of(Surface.of(frame)),
        "surface, steady, holes, mesh, 640x720": lambda: mesh_of(fill_small_holes(steady.next(Surface.of(frame)))),
    }
    note = f"{len(triangles)} triangles; the peer makes normals only"
    rows = [BenchRow(name, *_pair(interleave(work, peer)), note) for name, work in works.items()]
    ours_ms, peer_ms = interleave(lambda: mesh_ply(mesh), exported)
    return [*rows, BenchRow("mesh as PLY, 640x720", ours_ms, "trimesh", peer_ms, "the peer without sigma and pixels")]


def _pair(times: tuple[float, float]) -> tuple[float, str, float]:
    return times[0], "trimesh vertex normals", times[1]
