"""A sequence of meshes as files: one a frame, all of the same grid, with a list of what they are and a film to look at."""

from __future__ import annotations

import json
import math
import secrets
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import cv2
import numpy as np

from prismstereo.export.frames import ExportFrame
from prismstereo.export.glb import mesh_glb
from prismstereo.export.grid_mesh import GridMesh
from prismstereo.reconstruction.gates import Gates
from prismstereo.reconstruction.holes import HOLE_PX, fill_small_holes
from prismstereo.reconstruction.mesh import CUT_SIGMAS, Mesh, mesh_of
from prismstereo.reconstruction.mesh_picture import Sight, mesh_picture
from prismstereo.reconstruction.mesh_ply import mesh_ply
from prismstereo.reconstruction.steady import Steady
from prismstereo.reconstruction.surface import Surface
from prismstereo_hw.errors import DataError
from prismstereo_hw.files import write_whole

__all__ = ["FORMATS", "LIST", "PREVIEW", "MeshedFrame", "SequenceWishes", "write_sequence"]

FORMATS = ("ply", "glb")
LIST, PREVIEW = "meshes.json", "preview.mp4"
_SCHEMA = "prismstereo-meshes/1"
_SWAY_DEG, _SWAY_FRAMES = 20.0, 60
_PREVIEW_SIZE = (640, 480)


@dataclass(frozen=True, slots=True)
class SequenceWishes:
    """How meshes are made and written. `hole_px` 0 leaves holes open, `memory` 1 frame remembers nothing.

    `preview_hz` is the rate of the film, None for no film.
    """

    formats: tuple[str, ...] = ("ply",)
    gates: Gates = field(default_factory=Gates)
    hole_px: int = HOLE_PX
    cut_sigmas: float = CUT_SIGMAS
    memory: float = 1.0
    preview_hz: float | None = None


@dataclass(frozen=True, slots=True)
class MeshedFrame:
    """What became of a frame: how many vertices and triangles, how many pixels were filled in, one typical sigma.

    The sigma is the median along the ray, in the calibration's unit; None for a frame without a mesh, which has no files.
    """

    index: int
    timestamp_us: int
    vertices: int
    triangles: int
    filled_pixels: int
    median_sigma: float | None
    files: tuple[str, ...]


def write_sequence(out: Path, frames: Iterable[ExportFrame], wishes: SequenceWishes) -> list[MeshedFrame]:
    """Write NUMBER.ply and NUMBER.glb of every frame that has a mesh, then the list; each file whole or not at all.

    `DataError` where there is no frame, or none has a mesh.
    """
    steady, made = Steady(wishes.memory), list[MeshedFrame]()
    unit, size = "mm", (0, 0)
    film = None if wishes.preview_hz is None else _Film(out / PREVIEW, wishes.preview_hz)
    try:
        for frame in frames:
            surface = steady.next(Surface.of(frame, wishes.gates))
            if wishes.hole_px:
                surface = fill_small_holes(surface, wishes.hole_px)
            mesh = mesh_of(surface, wishes.cut_sigmas)
            made.append(_write(out, frame, mesh, int(surface.filled.sum()), wishes.formats))
            unit, size = mesh.unit, (frame.geometry.width, frame.geometry.height)
            if film is not None:
                film.add(mesh)
        if not any(one.triangles for one in made):
            raise DataError(
                f"{len(made)} frames, and no mesh in any: nothing was matched in the region and depths that were asked for"
            )
        if film is not None:
            film.finish()
    finally:
        if film is not None:
            film.forget()
    told = {"schema": _SCHEMA, "unit": unit, "grid_width": size[0], "grid_height": size[1]}
    told["frame"] = "PLY: rectified left camera, x right, y down, z forward; GLB: the same in metres, y up, z backward"
    told["meshes"] = [asdict(one) for one in made]
    write_whole(out / LIST, json.dumps(told, indent=1, allow_nan=False).encode())
    return made


def _write(out: Path, frame: ExportFrame, mesh: Mesh, filled: int, formats: tuple[str, ...]) -> MeshedFrame:
    files = []
    for form in formats if len(mesh.triangles) else ():
        files.append(f"{frame.index:06d}.{form}")
        write_whole(out / files[-1], mesh_ply(mesh) if form == "ply" else _glb(frame, mesh))
    sigma = float(np.median(mesh.sigma)) if len(mesh.sigma) else None
    stamp_us = frame.timestamp_ns // 1000
    return MeshedFrame(frame.index, stamp_us, len(mesh.points), len(mesh.triangles), filled, sigma, tuple(files))


def _glb(frame: ExportFrame, mesh: Mesh) -> bytes:
    metric = GridMesh(mesh.points * np.float32(frame.geometry.metres), mesh.texture, mesh.triangles)
    return mesh_glb(metric, frame.left, f"frame {frame.index}")


class _Film:
    """The meshes from a viewpoint that sways; written under another name until it is whole."""

    def __init__(self, path: Path, rate_hz: float) -> None:
        self._path, self._rate_hz = path, rate_hz
        self._unfinished = path.parent / f".{secrets.token_hex(6)}{path.suffix}"
        self._writer: cv2.VideoWriter | None = None
        self._sight: Sight | None = None
        self._count = 0

    def add(self, mesh: Mesh) -> None:
        """Draw the next mesh; the sight stays that of the first one with triangles."""
        if self._sight is None and not len(mesh.triangles):
            return
        self._sight = self._sight or Sight.onto(mesh, *_PREVIEW_SIZE)
        yaw = _SWAY_DEG * math.sin(2 * math.pi * self._count / _SWAY_FRAMES)
        self._open().write(mesh_picture(mesh, self._sight, yaw_deg=yaw))
        self._count += 1

    def finish(self) -> None:
        """Give the film its name."""
        if self._writer is not None:
            self._writer.release()
            self._unfinished.replace(self._path)

    def forget(self) -> None:
        """Remove what is unfinished."""
        if self._writer is not None:
            self._writer.release()
        self._unfinished.unlink(missing_ok=True)

    def _open(self) -> cv2.VideoWriter:
        if self._writer is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            code = cv2.VideoWriter.fourcc(*"mp4v")
            self._writer = cv2.VideoWriter(str(self._unfinished), code, self._rate_hz, _PREVIEW_SIZE)
            if not self._writer.isOpened():
                raise DataError(f"no film can be begun at {self._path}: leave --preview out, or give another folder")
        return self._writer
