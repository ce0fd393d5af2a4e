"""`prismstereo simulate`: a session from the optical twin."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from prismstereo.cli.output import json_option, say, with_progress
from prismstereo_hw.errors import UsageError

if TYPE_CHECKING:
    from prismstereo_hw.sensor import SensorModel
    from prismstereo_hw.session import SessionInfo, SessionWriter
    from prismstereo_hw.twin import Twin

_DEFOCUS_SAMPLES = 16
_STILL_AFTER_US = 500_000  # a board at rest: the camera takes its time to change modes
_COLUMNS, _ROWS = 9, 7  # inner corners of the simulated calibration board


@click.command(
    "simulate", epilog="Example:  prismstereo simulate oak-1 --scene desk --frames 10 --boards 15 --out desk"
)
@click.argument("rig")
@click.option(
    "--scene", default="desk", show_default=True, help="desk, face, toy-car, street, plane:MM, sphere:MM or board:MM."
)
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Session folder to make.")
@click.option("--frames", default=5, show_default=True, type=click.IntRange(0, 100_000), help="Video frames.")
@click.option(
    "--stills",
    default=0,
    show_default=True,
    type=click.IntRange(0, 1000),
    help="Full-sensor stills, at irregular instants a second apart or more.",
)
@click.option("--boards", default=0, show_default=True, type=click.IntRange(0, 200), help="Calibration board views.")
@click.option(
    "--board-stills",
    default=0,
    show_default=True,
    type=click.IntRange(0, 200),
    help="The first so many board poses as stills too, to tie still and video together.",
)
@click.option(
    "--noise", default=1.0, show_default=True, type=click.FloatRange(0, 50), help="Read noise, grey levels at gain 1."
)
@click.option("--sensor-noise", is_flag=True, help="Add the noise of the photons to the read noise.")
@click.option(
    "--exposure-us",
    default=10_000.0,
    show_default=True,
    type=click.FloatRange(1, 1_000_000),
    help="Exposure; the scene's own grey levels are those at the default.",
)
@click.option("--gain", default=1.0, show_default=True, type=click.FloatRange(0.01, 1000), help="Gain after exposure.")
@click.option(
    "--motion-blur",
    default=1,
    show_default=True,
    type=click.IntRange(1, 256),
    help="Instants averaged over the exposure.",
)
@click.option(
    "--pupil-samples",
    default=1,
    show_default=True,
    type=click.IntRange(1, 256),
    help="Points of the pupil near the seam: 8 to 16 show the band in which both views mix.",
)
@click.option("--defocus", is_flag=True, help="Sample the pupil everywhere: blur by distance, vignetting.")
@click.option(
    "--rolling-shutter-us", default=0.0, show_default=True, type=click.FloatRange(0, 1000), help="Delay per row."
)
@click.option("--dust", default=0, show_default=True, type=click.IntRange(0, 500), help="Specks on glass and mirrors.")
@click.option("--drops", default=0, show_default=True, type=click.IntRange(0, 100), help="Drops on glass and mirrors.")
@click.option(
    "--temperature-c",
    default=20.0,
    show_default=True,
    type=click.FloatRange(-40, 90),
    help="The mount expands from 20.",
)
@click.option("--seed", default=1, show_default=True, help="Makes textures, poses, still times and noise.")
@json_option
def command(
    rig: str, scene: str, out: Path, frames: int, stills: int, boards: int, board_stills: int, noise: float,
    sensor_noise: bool, exposure_us: float, gain: float, motion_blur: int, pupil_samples: int, defocus: bool,
    rolling_shutter_us: float, dust: int, drops: int, temperature_c: float, seed: int, as_json: bool,
) -> None:  # fmt: skip
    """Render a session of RIG before a scene: raw video, stills, board views, and the truth behind every frame."""
    from prismstereo_calibration.model import Calibration
    from prismstereo_calibration.store import write
    from prismstereo_hw.pupil import Pupil
    from prismstereo_hw.rig import Rig
    from prismstereo_hw.scene import named
    from prismstereo_hw.session import SessionWriter
    from prismstereo_hw.surroundings import Surroundings, seeded_spots
    from prismstereo_hw.twin import Twin

    if not frames + stills + boards:
        raise UsageError("a session of nothing: ask for some --frames, --stills or --boards")
    if board_stills > boards:
        raise UsageError(
            f"--board-stills {board_stills} of --boards {boards}: a still shows one of the board poses again"
        )
    built = Rig.read(rig)
    sensor = _sensor(noise, exposure_us, gain, motion_blur, rolling_shutter_us, photons=sensor_noise)
    twin = Twin(
        built,
        named(built, scene, seed),
        noise=noise,
        seed=seed,
        pupil=Pupil(max(pupil_samples, _DEFOCUS_SAMPLES) if defocus else pupil_samples, defocus=defocus),
        sensor=sensor,
        surroundings=Surroundings(temperature_c=temperature_c, spots=seeded_spots(built, seed, dust=dust, drops=drops)),
    )
    writer = SessionWriter(out, built, scene, standing=twin.standing)
    for index in with_progress(range(frames), frames, "video"):
        writer.add("video", twin.frame(index))
        writer.add_truth(index, twin.truth(index))
    _add_stills(writer, twin, stills)
    square_mm = _add_boards(writer, twin, boards, board_stills)
    write(out / "calibration.json", Calibration.nominal(built))
    info = writer.finish(board=f"chessboard:{_COLUMNS}x{_ROWS}" if boards else "", square_mm=square_mm)
    _tell(out, info, as_json=as_json)


def _tell(out: Path, info: SessionInfo, *, as_json: bool) -> None:
    say(
        {
            "session": out,
            "rig": info.rig,
            "video_frames": info.video_frames,
            "still_frames": info.still_frames,
            "board_frames": info.board_frames,
            "board_still_frames": info.board_still_frames,
            "board": info.board,
            "square_mm": info.square_mm,
        },
        [
            f"{out}: {info.video_frames} video frames, {info.still_frames} stills, {info.board_frames} board views of "
            f"{info.rig} before {info.scene}"
        ],
        as_json=as_json,
    )


def _sensor(
    noise: float, exposure_us: float, gain: float, motion_blur: int, rolling_shutter_us: float, *, photons: bool
) -> SensorModel | None:
    """Return the sensor that the options ask for; None where plain noise will do."""
    from prismstereo_hw.sensor import SensorModel

    plain = SensorModel()
    asked = (gain, exposure_us, motion_blur, rolling_shutter_us, photons)
    if asked == (plain.gain, plain.exposure_us, 1, 0.0, False):
        return None
    return SensorModel(
        exposure_us=exposure_us,
        gain=gain,
        read_noise_electrons=noise * plain.electrons_per_grey,
        shot_noise=photons,
        motion_samples=motion_blur,
        rolling_shutter_us=rolling_shutter_us,
    )


def _add_stills(writer: SessionWriter, twin: Twin, count: int) -> None:
    """Take stills as a person does who watches the video: at irregular instants, never two within a second."""
    from dataclasses import replace

    from prismstereo_hw.modes import still_instants_us

    camera = replace(twin, mode=twin.rig.camera.still, seed=twin.seed + 1)
    instants = still_instants_us(count, twin.seed)
    for index, instant_us in enumerate(with_progress(instants, count, "stills") if count else ()):
        writer.add("stills", camera.frame(index, timestamp_us=instant_us))


def _add_boards(writer: SessionWriter, twin: Twin, count: int, stills: int) -> float:
    """Render the board in seeded poses before a wall, the first few as stills too; return its square in mm, 0 without."""
    from dataclasses import replace

    from prismstereo_hw.scene import Scene, board, board_poses, facing_plane

    rig = twin.rig
    wall = facing_plane(rig, 3 * rig.range.near_mm, twin.seed).surfaces
    poses = board_poses(rig, count, twin.seed, columns=_COLUMNS, rows=_ROWS) if count else []
    for index, (square_mm, R, t) in enumerate(with_progress(poses, count, "boards") if count else ()):
        scene = Scene("board", (board(_COLUMNS, _ROWS, square_mm, R, t), *wall))
        shown = replace(twin, scene=scene, seed=twin.seed + 2 + index)
        writer.add("boards", shown.frame(index, timestamp_us=index * 1_000_000))
        if index < stills:
            taken = replace(shown, mode=rig.camera.still, seed=twin.seed + 2 + count + index)
            writer.add("boards_still", taken.frame(index, timestamp_us=index * 1_000_000 + _STILL_AFTER_US))
    return poses[0][0] if poses else 0.0
