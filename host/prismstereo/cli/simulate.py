"""`prismstereo simulate`: a session from the optical twin."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.session import SessionWriter
    from prismstereo_hw.twin import Twin

_COLUMNS, _ROWS = 9, 7  # inner corners of the simulated calibration board


@click.command(
    "simulate", epilog="Example:  prismstereo simulate oak-1 --scene desk --frames 10 --boards 15 --out desk"
)
@click.argument("rig")
@click.option("--scene", default="desk", show_default=True, help="desk, plane:MM or board:MM.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Session folder to make.")
@click.option("--frames", default=5, show_default=True, type=click.IntRange(0, 100_000), help="Video frames.")
@click.option(
    "--stills", default=0, show_default=True, type=click.IntRange(0, 1000), help="Full-sensor stills, 1 s apart."
)
@click.option("--boards", default=0, show_default=True, type=click.IntRange(0, 200), help="Calibration board views.")
@click.option(
    "--noise", default=1.0, show_default=True, type=click.FloatRange(0, 50), help="Sensor noise, grey levels."
)
@click.option("--seed", default=1, show_default=True, help="Makes textures, poses and noise.")
@json_option
def command(
    rig: str, scene: str, out: Path, frames: int, stills: int, boards: int, noise: float, seed: int, as_json: bool
) -> None:
    """Render a session of RIG before a scene: raw video, stills, board views, and the truth behind every frame."""
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.store import write
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.scene import named
    from prismstereo_hw.session import SessionWriter
    from prismstereo_hw.twin import Twin

    if not frames + stills + boards:
        raise UsageError("a session of nothing: ask for some --frames, --stills or --boards")
    built = Rig.read(rig)
    twin = Twin(built, named(built, scene, seed), noise=noise, seed=seed)
    writer = SessionWriter(out, built, scene)
    for index in with_progress(range(frames), frames, "video"):
        writer.add("video", twin.frame(index))
        writer.add_truth(index, twin.truth(index))
    still_twin = Twin(built, twin.scene, mode=built.camera.still, noise=noise, seed=seed + 1)
    for index in with_progress(range(stills), stills, "stills"):
        writer.add("stills", still_twin.frame(index, timestamp_us=index * 1_000_000))
    square_mm = _add_boards(writer, built, twin, boards)
    write(out / "calibration.json", Calibration.nominal(built))
    info = writer.finish(board=f"chessboard:{_COLUMNS}x{_ROWS}" if boards else "", square_mm=square_mm)
    say(
        {
            "session": out,
            "rig": built.name,
            "video_frames": info.video_frames,
            "still_frames": info.still_frames,
            "board_frames": info.board_frames,
            "board": info.board,
            "square_mm": info.square_mm,
        },
        [
            f"{out}: {info.video_frames} video frames, {info.still_frames} stills, {info.board_frames} board views of "
            f"{built.name} before {scene}"
        ],
        as_json=as_json,
    )


def _add_boards(writer: SessionWriter, rig: Rig, twin: Twin, count: int) -> float:
    """Render the board in seeded poses before a wall; return its square in mm, 0 without boards."""
    from dataclasses import replace

    from prismstereo_hw.scene import Scene, board, board_poses, facing_plane

    wall = facing_plane(rig, 3 * rig.range.near_mm, twin.seed).surfaces
    poses = board_poses(rig, count, twin.seed, columns=_COLUMNS, rows=_ROWS) if count else []
    for index, (square_mm, R, t) in enumerate(with_progress(poses, count, "boards") if count else ()):
        scene = Scene("board", (board(_COLUMNS, _ROWS, square_mm, R, t), *wall))
        shown = replace(twin, scene=scene, seed=twin.seed + 2 + index)
        writer.add("boards", shown.frame(index, timestamp_us=index * 1_000_000))
    return poses[0][0] if poses else 0.0
