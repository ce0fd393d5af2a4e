"""`prismstereo reconstruct`: metric meshes of every frame."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.matching import Matching, matching_options
from prismstereo.cli.output import RANGE_HELP, json_option, parse_range, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo.export.frames import ExportFrame
    from prismstereo.measuring.frames import RecordedFrames, TakenFrames
    from prismstereo.measuring.patch import Patch
    from prismstereo.reconstruction.gates import Gates
    from prismstereo.reconstruction.sequence import MeshedFrame

_PATCH_SIDES = 4
_RATE_HZ = 15.0  # of a film whose source does not tell


@click.command(
    "reconstruct",
    epilog="Examples:  prismstereo reconstruct desk -o meshes\n\n"
    "           prismstereo reconstruct face.mcap --format glb --gate-mm 350:600 --preview -o meshes",
)
@click.argument("source", type=click.Path(path_type=Path))
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Folder for the results.")
@click.option(
    "--calibration", type=click.Path(path_type=Path), help="Calibration file; a session and a recording have their own."
)
@click.option(
    "--format", "formats", multiple=True, default=("ply",), show_default=True, type=click.Choice(["ply", "glb"]),
    help="Of the meshes; once for each.",
)  # fmt: skip
@click.option("--first", default=0, show_default=True, type=click.IntRange(0), help="The first frame, from 0.")
@click.option("--frames", "most", type=click.IntRange(1), help="How many frames. Default: all.")
@click.option("--gate-mm", metavar="A:Z", help="Keep depths from A to Z mm; Z may be inf.")
@click.option("--roi", metavar="X,Y,W,H", help="Keep this part of the rectified left picture.")
@click.option("--holes", default="small", show_default=True, type=click.Choice(["none", "small"]), help="Fill which.")
@click.option("--hole-px", default=64, show_default=True, type=click.IntRange(1), help="Largest of the small holes.")
@click.option(
    "--cut", "cut_sigmas", default=4.0, show_default=True, type=click.FloatRange(0.1, 1000),
    help="Cut where depth leaps by so many standard deviations.",
)  # fmt: skip
@click.option(
    "--memory", default=8.0, show_default=True, type=click.FloatRange(1, 1000),
    help="Frames that resting parts are smoothed over; 1 for none.",
)  # fmt: skip
@click.option("--preview", is_flag=True, help="Also write preview.mp4, from a viewpoint that sways.")
@click.option("--range-mm", "range_mm", metavar="A:Z", help=RANGE_HELP)
@matching_options
@json_option
def command(
    source: Path, out: Path, calibration: Path | None, formats: tuple[str, ...], first: int, most: int | None,
    gate_mm: str | None, roi: str | None, holes: str, hole_px: int, cut_sigmas: float, memory: float, preview: bool,
    range_mm: str | None, matching: Matching, as_json: bool,
) -> None:  # fmt: skip
    """Write a metric mesh of every frame of SOURCE: a session folder, pictures, or an MCAP recording.

    NUMBER.ply is in mm and has normals, colours and one standard deviation of each point along its ray; NUMBER.glb is in
    metres, with the left picture on it. All have one grid of vertices; meshes.json lists them.
    """
    from prismstereo.measuring.frames import open_frames
    from prismstereo.reconstruction.sequence import SequenceWishes, write_sequence

    matcher = matching.create() if matching.matcher or source.suffix.lower() != ".mcap" else None
    gates = _gates(gate_mm, roi)
    opened = open_frames(source, calibration, matcher, matching.chain(), parse_range(range_mm, 1024))
    wishes = SequenceWishes(
        formats=tuple(dict.fromkeys(formats)),
        gates=gates,
        hole_px=hole_px if holes == "small" else 0,
        cut_sigmas=cut_sigmas,
        memory=memory,
        preview_hz=_rate_hz(opened) if preview else None,
    )
    made = write_sequence(out, _frames(opened, first, most), wishes)
    meshed = [one for one in made if one.triangles]
    told = {"source": source, "out": out, "formats": list(wishes.formats), "preview": preview,
            "frames": [_told(one) for one in made]}  # fmt: skip
    triangles = sum(one.triangles for one in meshed) // len(meshed)
    lines = [f"wrote meshes of {len(meshed)} frames, {triangles} triangles each on average, to {out}"]
    if len(meshed) < len(made):
        lines.append(f"{len(made) - len(meshed)} frames have no mesh: nothing was matched in them")
    say(told, lines, as_json=as_json)


def _frames(opened: TakenFrames | RecordedFrames, first: int, most: int | None) -> Iterator[ExportFrame]:
    from prismstereo.measuring.frames import TakenFrames

    end = None if most is None else first + most
    total = len(opened.paths[first:end]) if isinstance(opened, TakenFrames) else most
    for frame in with_progress(opened.frames(first, end), total, "meshes"):
        yield frame.depth


def _rate_hz(opened: TakenFrames | RecordedFrames) -> float:
    from prismstereo.measuring.frames import TakenFrames

    session = opened.session if isinstance(opened, TakenFrames) else None
    return _RATE_HZ if session is None else session.info.video_rate_hz


def _told(one: MeshedFrame) -> dict[str, object]:
    return {
        "frame": one.index,
        "vertices": one.vertices,
        "triangles": one.triangles,
        "filled_pixels": one.filled_pixels,
        "median_sigma": one.median_sigma,
        "files": list(one.files),
    }


def _gates(gate_mm: str | None, roi: str | None) -> Gates:
    from prismstereo.reconstruction.gates import Gates

    wish = parse_range(gate_mm, 1024)
    region = None if roi is None else _patch(roi)
    return Gates(region=region) if wish is None else Gates(wish.near_mm, wish.far_mm, region)


def _patch(text: str) -> Patch:
    from prismstereo.measuring.patch import Patch

    sides = [side.strip() for side in text.split(",")]
    if len(sides) != _PATCH_SIDES or not all(side.isascii() and side.isdigit() for side in sides):
        raise UsageError(f"--roi {text}: give X,Y,WIDTH,HEIGHT in whole pixels, e.g. 100,50,320,240")
    return Patch(*map(int, sides))
