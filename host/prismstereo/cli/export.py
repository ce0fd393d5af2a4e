"""`prismstereo export`: a session or a recording in the files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from prismstereo.cli.matching import Matching, matching_options
from prismstereo.cli.output import json_option, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.export.formats import Exported
    from prismstereo.export.ros_messages import FrameNames
    from prismstereo.export.sources import FrameSource

_FORMATS = ("ros2", "ply", "glb", "las", "laz", "png16", "video", "urdf")
_NAME = "abcdefghijklmnopqrstuvwxyz0123456789_"


@click.command("export", epilog="Example:  prismstereo export desk --to glb --mesh --frames 0:1 -o desk.glb")
@click.argument("source", required=False, type=click.Path(path_type=Path))
@click.option("--to", "target", required=True, type=click.Choice(_FORMATS), help="Format to write.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="File or folder for the result.")
@click.option(
    "--frames", "span", metavar="A:B", help="Only these, counted from 0, B not included; either may be left out."
)
@click.option(
    "--calibration", type=click.Path(path_type=Path), help="Of a session, or for urdf. Default: what the source holds."
)
@click.option("--mesh", is_flag=True, help="glb: triangles with the left picture on them, instead of points.")
@click.option(
    "--jump",
    default=0.05,
    show_default=True,
    type=click.FloatRange(0, 10),
    help="glb --mesh: no triangle spans depths that differ by a larger share.",
)
@click.option(
    "--depth",
    type=click.Choice(["16UC1", "32FC1"]),
    default="16UC1",
    show_default=True,
    help="ros2: depth in whole mm, or in metres as float32.",
)
@click.option(
    "--name", "sensor", default="prismstereo", show_default=True, help="ros2, urdf: begins topics and frames."
)
@click.option("--rig", help="urdf: a built-in rig, or a rig file.")
@click.option("--mount", type=click.Path(path_type=Path), help="urdf: mesh of the mount, if the rig is not built in.")
@matching_options
@json_option
def command(
    source: Path | None, target: str, out: Path, span: str | None, calibration: Path | None, mesh: bool, jump: float,
    depth: Literal["16UC1", "32FC1"], sensor: str, rig: str | None, mount: Path | None, matching: Matching, as_json: bool,
) -> None:  # fmt: skip
    """Write the frames of SOURCE, a session folder or an MCAP recording, in the files of other programs.

    ros2: a rosbag2 folder with left/image_rect, camera_info, disparity, depth, points2 and tf_static (extra ros).

    ply, glb, las, laz: a file a frame. ply in mm; glb in metres, as points or (--mesh) with the picture on triangles; las
    and laz in metres with z up (extra las).

    png16: disparity in sixteenths of a pixel, and frames.json with what makes depth of it. video: depth, as .mp4 or .avi.

    urdf: a robot description of --rig with its mount; it takes no SOURCE.
    """
    from prismstereo.export.formats import Wishes, export
    from prismstereo.export.ros_messages import FrameNames

    if not sensor or set(sensor) - set(_NAME) or not sensor[0].isalpha():
        raise UsageError(f"--name {sensor!r}: ROS wants small letters, digits and _, beginning with a letter")
    names = FrameNames(sensor)
    if target == "urdf":
        _describe(source, rig, mount, calibration, names, out, as_json=as_json)
        return
    if source is None:
        raise UsageError(f"--to {target} needs a SOURCE: a session folder, or a recording")
    if rig or mount:
        raise UsageError("--rig and --mount go with --to urdf: a session and a recording know their own calibration")
    first, end = _span(span)
    opened = _open(source, calibration, matching)
    try:
        total = None if opened.count is None else len(range(opened.count)[first:end])
        frames = with_progress(opened.frames(first, end), total, target)
        written = export(target, out, frames, Wishes(mesh, jump, depth, names))
    finally:
        opened.close()
    _tell(target, out, written, as_json=as_json)


def _tell(target: str, out: Path, written: Exported, *, as_json: bool) -> None:
    result = {
        "format": target,
        "out": out,
        "frames": written.frames,
        "points": written.points,
        "rate_hz": written.rate_hz,
        "files": list(written.paths),
    }
    points = "" if written.points is None else f", {written.points} points"
    rate = "" if written.rate_hz is None else f", {written.rate_hz:.3g} Hz"
    say(result, [f"wrote {written.frames} frames{points}{rate} as {target} to {out}"], as_json=as_json)


def _span(text: str | None) -> tuple[int, int | None]:
    if text is None:
        return 0, None
    first, colon, end = (part.strip() for part in text.partition(":"))
    if not colon or any(part and not (part.isascii() and part.isdigit()) for part in (first, end)):
        raise UsageError(f"--frames {text}: give A:B in whole numbers from 0, e.g. 0:10, :10 or 5:")
    span = int(first or 0), int(end) if end else None
    if span[1] is not None and span[0] >= span[1]:
        raise UsageError(f"--frames {text} is empty: B is not included, give A < B")
    return span


def _open(source: Path, calibration: Path | None, matching: Matching) -> FrameSource:
    from prismstereo.export.sources import RecordingSource, SessionSource

    if (source / "session.toml").is_file():
        return SessionSource(source, calibration, matching.create(), matching.chain())
    if source.is_file():
        if calibration is not None or matching.matcher or matching.filters:
            raise UsageError(
                "a recording holds what the camera matched, and its calibration: `prismstereo replay` with --matcher and "
                "--calibration makes new depth of the raw frames in it"
            )
        return RecordingSource(source)
    raise UsageError(f"{source} is neither a session folder nor a recording: give one of the two")


def _describe(
    source: Path | None, rig: str | None, mount: Path | None, calibration: Path | None, names: FrameNames, out: Path,
    *, as_json: bool,
) -> None:  # fmt: skip
    from prismstereo.export.urdf import committed_mount, placing, write_urdf
    from prismstereo_calibration.store import read
    from prismstereo_hw.rig import Rig

    if source is not None or rig is None:
        raise UsageError("--to urdf describes a rig: give --rig oak-1 (or a rig file) and no SOURCE")
    built = Rig.read(rig)
    mesh = mount or committed_mount(built.name)
    placed = placing(built, None if calibration is None else read(calibration))
    paths = write_urdf(out, placed, names=names, mesh=mesh)
    lines = [f"wrote {', '.join(str(path) for path in paths)}"]
    if mesh is None:
        lines.append(
            f"without a mesh: {built.name} has no mount here, make one with hw/mount/build.py and give --mount"
        )
    say(
        {"format": "urdf", "out": out, "rig": built.name, "mesh": mesh is not None, "files": paths},
        lines,
        as_json=as_json,
    )
