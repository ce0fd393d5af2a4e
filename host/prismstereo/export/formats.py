"""The formats by name, and how a source's frames become each: files a frame, one file, or a folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from prismstereo.export.frames import ExportFrame
from prismstereo.export.ros_frame import DepthEncoding
from prismstereo.export.ros_messages import FrameNames
from prismstereo_hw.errors import DataError
from prismstereo_hw.files import write_whole

__all__ = ["FORMATS", "PER_FRAME", "Exported", "Wishes", "export"]

PER_FRAME = ("ply", "glb", "las", "laz")  # formats of one file a frame
FORMATS = ("ros2", *PER_FRAME, "png16", "video")


@dataclass(frozen=True, slots=True)
class Wishes:
    """What can be chosen: triangles for GLB, how far their depth may jump, ROS's depth encoding and frame names."""

    mesh: bool = False
    jump: float = 0.05
    depth: DepthEncoding = "16UC1"
    names: FrameNames = field(default_factory=FrameNames)


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written: its paths, how many frames, and how many points where points were."""

    paths: tuple[Path, ...]
    frames: int
    points: int | None = None
    rate_hz: float | None = None


def export(name: str, out: Path, frames: Iterable[ExportFrame], wishes: Wishes) -> Exported:
    """Write frames in a format of `FORMATS`; `out` is a folder, for video a file, for one file a frame either.

    Raises UsageError for what the format cannot tell, or whose package is missing, DataError for a source without frames.
    """
    if name == "ros2":
        from prismstereo.export.ros_bag import write_bag

        count = write_bag(out, frames, names=wishes.names, depth=wishes.depth)
        return Exported((out,), count)
    if name == "png16":
        from prismstereo.export.png16 import LIST, write_png16

        counted = _Counted(frames)
        paths = write_png16(out, counted)
        return Exported((out / LIST, *(path for path in paths if path.name != LIST)), _some(counted.count, out))
    if name == "video":
        from prismstereo.export.film import write_film

        count, rate_hz = write_film(out, frames)
        return Exported((out,), count, rate_hz=rate_hz)
    return _one_by_one(name, out, frames, wishes)


class _Counted:
    """Counts what goes through."""

    def __init__(self, frames: Iterable[ExportFrame]) -> None:
        self._frames = frames
        self.count = 0

    def __iter__(self) -> Iterator[ExportFrame]:
        for frame in self._frames:
            self.count += 1
            yield frame


def _one_by_one(name: str, out: Path, frames: Iterable[ExportFrame], wishes: Wishes) -> Exported:
    """Write a file for every frame; `out` with the format's ending is the file of a single one."""
    single = out.suffix.lower() == f".{name}"
    paths: list[Path] = []
    points = 0
    for frame in frames:
        if single and paths:
            raise DataError(
                f"{out} holds one frame, but there are more: give a folder, or one frame with --frames A:A+1"
            )
        content, count = _MAKERS[name](frame, wishes)
        paths.append(out if single else out / f"{frame.index:06d}.{name}")
        write_whole(paths[-1], content)
        points += count
    return Exported(tuple(paths), _some(len(paths), out), points)


def _some(count: int, out: Path) -> int:
    if not count:
        raise DataError(f"there are no frames to write to {out}: see what the source holds")
    return count


def _ply(frame: ExportFrame, wishes: Wishes) -> tuple[bytes, int]:
    del wishes
    cloud = frame.cloud()
    return cloud.ply(), len(cloud.points)


def _glb(frame: ExportFrame, wishes: Wishes) -> tuple[bytes, int]:
    from prismstereo.export.glb import mesh_glb, points_glb
    from prismstereo.export.grid_mesh import grid_mesh

    name = f"frame {frame.index}"
    if wishes.mesh:
        mesh = grid_mesh(frame, wishes.jump)
        return mesh_glb(mesh, frame.left, name), len(mesh.points_m)
    cloud = frame.cloud(frame.geometry.metres)
    return points_glb(cloud.points, cloud.colours, name), len(cloud.points)


def _las(frame: ExportFrame, wishes: Wishes, *, packed: bool = False) -> tuple[bytes, int]:
    from prismstereo.export.las import las_bytes

    del wishes
    cloud = frame.cloud(frame.geometry.metres)
    return las_bytes(cloud.points, cloud.colours, packed=packed), len(cloud.points)


def _laz(frame: ExportFrame, wishes: Wishes) -> tuple[bytes, int]:
    return _las(frame, wishes, packed=True)


_MAKERS: dict[str, Callable[[ExportFrame, Wishes], tuple[bytes, int]]] = {
    "ply": _ply,
    "glb": _glb,
    "las": _las,
    "laz": _laz,
}
